"""The three concerns of a case study, and what they mean together."""
