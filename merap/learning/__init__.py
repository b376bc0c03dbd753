"""Offline meta-learning over a base of tabular MDPs."""
