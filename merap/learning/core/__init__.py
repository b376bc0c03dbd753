"""The learner's inner loops on numpy arrays: many tasks at once, derivatives written out.

Products are numpy's; loops over states, branches and episodes are compiled by numba. The networks are small:
what automatic differentiation spends on its graph is many times what these numbers take. Neither numpy's
products nor the compiled loops hold the GIL, so that ranges of tasks run side by side on threads.

Axes: N tasks, S states, A actions, K successors, J inner steps, B episodes, T steps, P parameters in one
row, L layers, F features.
"""
