"""The knowledge base: what was known, seen, decided and learned online, for good."""
