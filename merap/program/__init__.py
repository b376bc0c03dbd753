"""The form of every world: variables, processes, commands; explored without a model checker."""
