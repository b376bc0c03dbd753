"""Reproductions of the paper's experiments as data and scores."""
