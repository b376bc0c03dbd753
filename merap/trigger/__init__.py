"""When to re-plan: the paper's threshold on a window's reward, and a change detector."""
