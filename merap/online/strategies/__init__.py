"""Adaptation strategies behind one interface (`merap.online.strategy.Strategy`)."""
