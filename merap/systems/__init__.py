"""What can be managed, beside a plain simulation: worlds with slip and sensors, Gymnasium, HTTP, guards."""
