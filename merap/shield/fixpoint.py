"""The least risk of ever reaching an unsafe state that can be promised under every credible model.

With D(s, a) the set of distributions of `outcomes` and u the unsafe states,

    rho(s)  = 1                          in u,
    rho(s)  = min over a of Q(s, a)      elsewhere,
    Q(s, a) = max over p in D(s, a) of sum over s' of p(s') (h(s') + (1 - h(s')) rho(s')),

the least solution: robust dynamic programming over rectangular sets (Iyengar 2005; Nilim and El
Ghaoui 2005), for the undiscounted reachability that shields are made of (Alshiekh et al. 2018;
Jansen et al. 2020). h(s') is the risk of a step by itself, as the hazard prior gives it
(`hazards`); it is 0 without one.

Nature's choice may differ each time a state is visited, so rho is an upper bound for every single
model. An action that some credible model disables can't be relied on: with q(s) the minimum over
the actions that are sure and Q(s) the maximum over all that are possible, rho(s) = min(q(s), Q(s)),
since in the worst case nature leaves only an action that is worst.

Where rho is 0 comes from the graph alone (the greatest set of states with a sure action all of
whose outcomes, under any distribution of the set, stay inside), so that a threshold of 0 involves
no numerics. Elsewhere values rise from 0, sweep by sweep. They are not the fixpoint yet when sweeping
stops, and need not be: what a budget (`budget`) promises for T steps is off by at most T times the last
change, the residual. Sweeping from above would be no remedy: where nature may let a move fail for
ever, the fixpoint is not unique. Where values rise slowly policy iteration (`game`) finds the least
fixpoint at once; what it finds is taken only if it solves the equations.

Axes as in `outcomes`; T steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from merap.errors import EngineError
from merap.mdp.csr import row_best
from merap.mdp.model import Bools, Floats
from merap.shield.game import make_game, row_at_risk, row_risk, solve
from merap.shield.outcomes import OutcomeSets

PRECISION = 1e-10
# Policy iteration is tried after so many sweeps, and again after so many times more.
FIRST_SWEEPS, MORE_SWEEPS = 200, 4
MAX_SWEEPS = 1_000_000
# A risk that is there but too small for its number.
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Risk:
    """What any behaviour risks at least, under the worst of the credible models.

    Attributes:
        of_states: float64 [S], rho.
        of_actions: float64 [S, A], Q; 1 where no credible model has the action.
        certain: bool [S, A], exactly where Q is 0.
        unsafe: bool [S].
        residual: by how much the values contradict the equations at most.
    """

    of_states: Floats
    of_actions: Floats
    certain: Bools
    unsafe: Bools
    residual: float


def robust_risk(sets: OutcomeSets, precision: float = PRECISION) -> Risk:
    """Solve the equations above.

    Args:
        sets: what each action may lead to.
        precision: of the residual.

    Raises:
        EngineError: the residual stays above the precision.
    """
    risky = sets.unsafe
    while True:
        of_choices = _choices_risky(sets, risky)
        grown = sets.unsafe | _states_risky(sets, of_choices)
        if np.array_equal(grown, risky):
            break
        risky = grown
    values, q, residual = _solved(sets, risky, precision)
    return Risk(
        of_states=values,
        of_actions=sets.table(_positive(q, of_choices), 1.0),
        certain=sets.table(~of_choices, False),
        unsafe=sets.unsafe,
        residual=residual,
    )


def _solved(sets: OutcomeSets, risky: Bools, precision: float) -> tuple[Floats, Floats, float]:
    """Values of the states, of the choices, and by how much they contradict each other at most.

    Sweeps, and by policy iteration if there would have to be many.
    """
    game = make_game(sets)
    values, attempt = sets.unsafe.astype(np.float64), FIRST_SWEEPS
    for sweep in range(1, MAX_SWEEPS + 1):
        better, q = _swept(sets, risky, values)
        residual = float(np.max(better - values, initial=0.0))
        if residual <= precision:
            return better, q, residual
        values = better
        if sweep < attempt:
            continue
        found = solve(game, values)
        # What the sweeps have reached is certain.
        if found is not None and np.all(found >= values - precision):
            better, q = _swept(sets, risky, found)
            contradiction = float(np.abs(better - found).max(initial=0.0))
            if contradiction <= precision:
                return better, q, contradiction
        attempt *= MORE_SWEEPS
    raise EngineError(f"the risk still grows by {residual:.1e} a sweep after {MAX_SWEEPS} sweeps")


def _swept(sets: OutcomeSets, risky: Bools, values: Floats) -> tuple[Floats, Floats]:
    """float64 [S], what the states' values become, and float64 [C], those of the choices."""
    q = choice_risk(sets, values)
    return np.where(risky, np.maximum(state_risk(sets, q), TINY), 0.0), q


def choice_risk(sets: OutcomeSets, values: Floats) -> Floats:
    """float64 [C], Q if the successors' risk is float64 [S]."""
    worst: Floats = np.maximum.reduceat(row_risk(sets.rows, values), sets.first)
    return worst


def state_risk(sets: OutcomeSets, of_choices: Floats) -> Floats:
    """float64 [S], rho if the choices' risk is float64 [C]; 0 where there is none."""
    relied = row_best(np.where(sets.sure, of_choices, np.inf), sets.state_pointers, maximise=False)
    worst = row_best(of_choices, sets.state_pointers, maximise=True)
    return np.where(sets.unsafe, 1.0, np.minimum(np.minimum(relied, worst), 1.0))


def _choices_risky(sets: OutcomeSets, risky: Bools) -> Bools:
    """bool [C], whether some distribution can lead to a risky state, or is a risk by itself."""
    found: Bools = np.logical_or.reduceat(row_at_risk(sets.rows, risky), sets.first)
    return found


def _states_risky(sets: OutcomeSets, of_choices: Bools) -> Bools:
    """bool [S]: `state_risk` is positive."""
    as_numbers = state_risk(sets, of_choices.astype(np.float64))
    return np.asarray(as_numbers > 0)


def _positive(q: Floats, risky: Bools) -> Floats:
    """float64 [C]: exactly 0 where nothing is at risk, and nowhere else."""
    return np.where(risky, np.clip(q, TINY, 1.0), 0.0)
