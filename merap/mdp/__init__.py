"""Finite Markov decision processes as arrays."""
