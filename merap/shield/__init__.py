"""Safety masks that hold for every model still credible: what may be done at what risk."""
