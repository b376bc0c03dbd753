"""A belief over what the real domain may be, and how to act on it."""
