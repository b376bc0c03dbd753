"""Adaptation strategies behind one interface (`merap.systems.strategy.Strategy`)."""
