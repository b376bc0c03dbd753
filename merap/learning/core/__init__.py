"""The learner's inner loops on numpy arrays: many tasks at once, derivatives written out.

Loops over tasks, states, branches and episodes are compiled by numba, products in them are those of BLAS. The
networks are small: what automatic differentiation spends on its graph is many times what these numbers take.
Compiled code does not hold the GIL, so that ranges of tasks run side by side on threads; it comes in few and
long calls, since a thread that waits for the GIL between them may wait longer than they take.

Axes: N tasks, S states, A actions, K successors, J inner steps, B episodes, T steps, P parameters in one
row, L layers, F features.
"""
