"""The MAPE-K loop: monitor, analyzer, planner, executor, learner, and scenarios to run it in."""
