"""The names that merap gives to variables, actions and labels of its models."""

from __future__ import annotations

MODE_VARIABLE = "mode"
# The variable that tells complete states apart; the canonical index has one state for all.
FLAG_VARIABLE = "done"
# The action that closes a complete state: it leads back there and earns nothing.
END_ACTION = "end"
COMPLETE_LABEL = "done"
# Also the name of the parameter whose locations carry the label.
GOAL_LABEL = "goal"
UNSAFE_LABEL = "unsafe"
# The reward structure of what the objective earns.
OBJECTIVE_REWARD = "objective"
