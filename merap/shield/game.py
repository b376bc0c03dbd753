"""Robust risk as a stochastic game, solved by policy iteration.

In a state the player picks an option, then nature one of the option's rows. An option is a sure
action; a state without any has a single option, of the rows of all its actions, as there nature picks
the action too.

Nature's rows improve from round to round, and the player answers each choice of rows as well as it can
(Hoffman and Karp 1966). It is nature that must lead: the value of each of its choices is a lower bound
of the risk, and one that solves the equations of the game is no less than the least solution, so it is
that. The player's choices would come from above, where a value can solve the equations and be too
large: if one action risks 1/2, and with another nature may risk 3/10 or stay for ever, then 1/2 does.

For rows of nature that are fixed, where the risk is 0 comes from the graph alone. Elsewhere no
behaviour stays for ever: where it could, it would avoid the unsafe states. So the equations of any
behaviour have one solution, and those of the best one are the only ones that no option improves.

Axes: R rows, K successors, O options, S states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from merap.mdp.model import Bools, Floats, Ints
from merap.shield.outcomes import OutcomeSets, Rows

# What is better by less may be so by rounding.
ROUNDING = 1e-14
# More linear systems than that are not worth it: values go round in circles, by rounding.
MAX_SYSTEMS = 40


@dataclass(frozen=True, eq=False)
class Game:
    """The game of outcome sets.

    Attributes:
        rows: R distributions, by option; `choice` is not used.
        first: int64 [O], the first row of each option.
        state: int64 [O], whose option it is, ascending.
        unsafe: bool [S].
    """

    rows: Rows
    first: Ints
    state: Ints
    unsafe: Bools

    @property
    def option(self) -> Ints:
        """int64 [R], of which option each row is."""
        return np.repeat(np.arange(len(self.first)), np.diff(self.first, append=len(self.rows.choice)))


def make_game(sets: OutcomeSets) -> Game:
    """The game of outcome sets; unsafe states have no options, the game is over there."""
    state = sets.choice // sets.num_actions
    relied = np.zeros(sets.num_states, dtype=np.bool_)
    relied[state[sets.sure]] = True
    kept = (sets.sure | ~relied[state]) & ~sets.unsafe[state]
    of_row = np.repeat(np.arange(len(sets.choice)), np.diff(sets.first, append=len(sets.rows.choice)))
    # States without a sure action have the number of their first action's option for all of them.
    begins = np.searchsorted(state, state)
    option = np.where(relied[state], np.arange(len(state)), begins)[of_row]
    used = kept[of_row]
    options, first = np.unique(option[used], return_index=True)
    return Game(sets.rows.taken(used), first, state[options], sets.unsafe)


def solve(game: Game, values: Floats) -> Floats | None:
    """The risk of each state by policy iteration.

    Args:
        game: to be solved.
        values: float64 [S], about the risk: both begin with what is best for these.

    Returns:
        float64 [S], up to rounding; None where numbers can't tell a loop that is hardly ever left from
        one that never is.
    """
    nature, left = _improved(game, _tempting(game), row_risk(game.rows, values)), MAX_SYSTEMS
    while True:
        answered = _answered(game, game.rows.taken(nature), values, left)
        if answered is None:
            return None
        values, left = answered
        better = _improved(game, nature, row_risk(game.rows, values))
        if np.array_equal(better, nature):
            return values
        nature = better


def row_risk(rows: Rows, values: Floats) -> Floats:
    """float64 [R], what each distribution risks if its successors risk float64 [S]."""
    found: Floats = (rows.prob * (rows.risk + (1 - rows.risk) * values[rows.target])).sum(axis=1)
    return found


def row_at_risk(rows: Rows, risky: Bools) -> Bools:
    """bool [R], whether a distribution can lead to a state at risk, bool [S], or is a risk by itself."""
    return np.asarray(((rows.prob > 0) & (risky[rows.target] | (rows.risk > 0))).any(axis=1))


def _tempting(game: Game) -> Ints:
    """int64 [O], rows that lead to risk from wherever nature can enforce that."""
    nature, found = game.first.copy(), np.zeros(len(game.first), dtype=np.bool_)
    risky = game.unsafe
    while True:
        of_rows = row_at_risk(game.rows, risky)
        new = np.logical_or.reduceat(of_rows, game.first) & ~found if len(found) else found
        nature = np.where(new, _first_row(game, of_rows), nature)
        found = found | new
        grown = risky | _states_at_risk(game, found)
        if np.array_equal(grown, risky):
            return nature
        risky = grown


def _first_row(game: Game, which: Bools) -> Ints:
    """int64 [O], the first row bool [R] of each option; behind all rows if it has none."""
    places = np.where(which, np.arange(len(which)), len(which))
    return np.minimum.reduceat(places, game.first) if len(game.first) else game.first


def _states_at_risk(game: Game, options: Bools) -> Bools:
    """bool [S], all of the options that there are, bool [O], are at risk."""
    risky = game.unsafe.copy()
    risky[game.state] = True
    risky[game.state[~options]] = False
    return risky


def _improved(game: Game, nature: Ints, of_rows: Floats) -> Ints:
    """int64 [O]: rows of nature, those that another one is really worse than replaced by the worst."""
    if not len(nature):
        return nature
    worst = np.maximum.reduceat(of_rows, game.first)
    largest = _first_row(game, of_rows >= worst[game.option])
    return np.where(worst > of_rows[nature] + ROUNDING, largest, nature)


def _answered(game: Game, rows: Rows, values: Floats, left: int) -> tuple[Floats, int] | None:
    """The least risk, float64 [S], while nature keeps to the rows, one for each option.

    With so many linear systems at most; the second result is how many are left.
    """
    risky = game.unsafe
    while True:
        grown = risky | _states_at_risk(game, row_at_risk(rows, risky))
        if np.array_equal(grown, risky):
            break
        risky = grown
    options = np.flatnonzero(risky[game.state])
    here = game.state[options]
    first = np.flatnonzero(np.diff(here, prepend=-1))
    chosen = _least(row_risk(rows, values)[options], first, None)
    for remaining in reversed(range(left)):
        solution = _reaching(rows.taken(options[chosen]), here[chosen], game.unsafe)
        if solution is None:
            return None
        better = _least(row_risk(rows, solution)[options], first, chosen)
        if np.array_equal(better, chosen):
            return solution, remaining
        chosen = better
    return None


def _least(of_options: Floats, first: Ints, chosen: Ints | None) -> Ints:
    """int64 [states at risk], the option of each that risks least; the chosen one if none is really less."""
    if not len(first):
        return first
    of_state = np.repeat(np.arange(len(first)), np.diff(first, append=len(of_options)))
    least = np.minimum.reduceat(of_options, first)
    places = np.where(of_options <= least[of_state], np.arange(len(of_options)), len(of_options))
    found = np.minimum.reduceat(places, first)
    return found if chosen is None else np.where(least < of_options[chosen] - ROUNDING, found, chosen)


def _reaching(rows: Rows, state: Ints, unsafe: Bools) -> Floats | None:
    """float64 [S], the risk in a Markov chain with a row for each state int64 [R]; 0 in all others.

    The diagonal is the sum of all that leads elsewhere, not 1 minus what stays: a state that is left
    once in 10^20 steps is left.
    """
    place = np.full(len(unsafe), -1)
    place[state] = np.arange(len(state))
    inward = rows.prob * (1 - rows.risk)
    stays = rows.target == state[:, np.newaxis]
    leaving = np.where(stays, rows.prob * rows.risk, rows.prob).sum(axis=1)
    falling = (rows.prob * rows.risk + inward * unsafe[rows.target]).sum(axis=1)
    row, slot = np.nonzero((place[rows.target] >= 0) & ~stays & (inward > 0))
    column = place[rows.target[row, slot]]
    diagonal = np.arange(len(state))
    system = csc_array(
        (
            np.concatenate([leaving, -inward[row, slot]]),
            (np.concatenate([diagonal, row]), np.concatenate([diagonal, column])),
        ),
        shape=(len(state), len(state)),
    )
    values = unsafe.astype(np.float64)
    if len(state):
        try:
            found = splu(system).solve(falling)
        except RuntimeError:  # the factor is exactly singular
            return None
        if not np.isfinite(found).all():
            return None
        values[state] = np.clip(found, 0.0, 1.0)
    return values
