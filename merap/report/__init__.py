"""Pictures: maps with policies and paths, adaptation curves."""
