"""Combinations as PRISM text."""
