"""Compute the maximal and minimal probability of reaching a set of states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from merap.errors import EngineError
from merap.mdp.csr import pointers_of, row_best
from merap.mdp.end_components import maximal_end_components
from merap.mdp.graph import attractor, states_reaching, surely_reaching
from merap.mdp.model import Bools, Floats, Ints, TabularMDP

_ZERO, _ONE = 0, 1  # classes of the quotient that are decided by the graph


@dataclass(frozen=True)
class ReachabilityBounds:
    """Certain bounds on the probability from each state, up to rounding.

    Attributes:
        lower: float64 [S].
        upper: float64 [S].
    """

    lower: Floats
    upper: Floats

    @property
    def middle(self) -> Floats:
        """float64 [S], with an error of at most half the distance of the bounds."""
        middle: Floats = (self.lower + self.upper) / 2
        return middle


@dataclass(frozen=True)
class _Quotient:
    """The states in classes: surely 0, surely 1, then end components and single states.

    Attributes:
        of_state: int64 [S], the class of a state.
        pointers: int64 [Q + 1], the choices of a class; the first two have none.
        transitions: float64 [choices, Q] sparse.
    """

    of_state: Ints
    pointers: Ints
    transitions: csr_array


def bounded_reachability(mdp: TabularMDP, target: Bools, steps: int, *, maximise: bool = True) -> Floats:
    """Return the extreme probability of reaching the target within some steps, exactly.

    Args:
        mdp: the model.
        target: bool [S].
        steps: the number of steps that may be taken.
        maximise: maximal or minimal.

    Returns:
        float64 [S].
    """
    values = target.astype(np.float64)
    for _ in range(steps):
        best = row_best(mdp.transitions @ values, mdp.state_to_choice, maximise=maximise)
        values = np.where(target, 1.0, best)
    return values


def reachability(
    mdp: TabularMDP,
    target: Bools,
    *,
    maximise: bool = True,
    precision: float = 1e-9,
    max_sweeps: int = 1_000_000,
) -> ReachabilityBounds:
    """Bound the extreme probability of ever reaching the target, by interval iteration.

    Probabilities 0 and 1 come from the graph. For the maximum, end components are merged
    into single states, without which the upper bound need not converge (Haddad and
    Monmege 2018; Baier et al. 2017).

    Args:
        mdp: the model.
        target: bool [S].
        maximise: maximal or minimal.
        precision: the largest distance of the bounds that is allowed.
        max_sweeps: the number of sweeps after which to give up.

    Raises:
        EngineError: the bounds are still further apart than `precision`.
    """
    zero, one = _decided_by_graph(mdp, target, maximise=maximise)
    quotient = _quotient(mdp, zero, one, merge=maximise)
    bounds = np.zeros((len(quotient.pointers) - 1, 2))
    bounds[_ONE] = 1
    bounds[_ONE + 1 :, 1] = 1
    for _ in range(max_sweeps):
        if np.all(bounds[:, 1] - bounds[:, 0] <= precision):
            return ReachabilityBounds(bounds[quotient.of_state, 0], bounds[quotient.of_state, 1])
        of_choices = quotient.transitions @ bounds
        for side in (0, 1):
            best = row_best(of_choices[:, side], quotient.pointers, maximise=maximise)
            bounds[_ONE + 1 :, side] = best[_ONE + 1 :]
    width = float(np.max(bounds[:, 1] - bounds[:, 0]))
    raise EngineError(f"reachability is only known up to {width:.1e} after {max_sweeps} sweeps")


def _decided_by_graph(mdp: TabularMDP, target: Bools, *, maximise: bool) -> tuple[Bools, Bools]:
    """Return bool [S] twice: the states of extreme probability 0, and those of 1."""
    every_choice = np.ones(mdp.num_choices, dtype=np.bool_)
    if maximise:
        return ~states_reaching(mdp, target, every_choice), surely_reaching(mdp, target)
    zero = ~attractor(mdp, target)
    # 1 exactly where no path that avoids the target leads to where it can be avoided for good.
    return zero, ~states_reaching(mdp, zero, every_choice, blocked=target)


def _quotient(mdp: TabularMDP, zero: Bools, one: Bools, *, merge: bool) -> _Quotient:
    undecided = ~zero & ~one
    usable = undecided[mdp.choice_state]
    own_class = np.arange(mdp.num_states)
    if merge:
        component, inner = maximal_end_components(mdp, undecided)
        usable &= ~inner
        own_class = np.where(component >= 0, mdp.num_states + component, own_class)
    # Classes 2, 3, ... in order of appearance of the undecided ones.
    compact = np.unique(own_class[undecided], return_inverse=True)[1] + 2
    of_state = np.where(one, _ONE, _ZERO)
    of_state[undecided] = compact
    choices = np.flatnonzero(usable)
    class_of_choice = of_state[mdp.choice_state[choices]]
    choices = choices[np.argsort(class_of_choice, kind="stable")]
    classes = int(of_state.max(initial=_ONE)) + 1
    fold = coo_array(
        (np.ones(mdp.num_states), (np.arange(mdp.num_states), of_state)), shape=(mdp.num_states, classes)
    )
    return _Quotient(
        of_state=of_state,
        pointers=pointers_of(np.bincount(class_of_choice, minlength=classes)),
        transitions=csr_array(mdp.transitions[choices] @ fold.tocsr()),
    )
