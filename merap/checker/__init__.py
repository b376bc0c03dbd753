"""Model checkers, and what they say of a model."""
