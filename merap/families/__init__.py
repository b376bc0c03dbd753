"""From a case to its model base."""
