"""Policies to take away: as tables that need no torch, and as PRISM text that needs nothing of ours.

Axes: S states of the canonical index (the completed state is the last), A declared actions, V state
variables.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from merap.checker.combination_model import build_combination
from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.families.build import canonical
from merap.learning.meta import MetaPolicy
from merap.learning.policy import action_logits, log_policy
from merap.mdp.alignment import align_actions, align_variables
from merap.mdp.chain import induced_chain
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.matching import match_rows
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.mdp.reserved_names import COMPLETE_LABEL, FLAG_VARIABLE
from merap.prism.rendering import render_policy


@dataclass(frozen=True, eq=False)
class PolicyTable:
    """What a policy does in every state.

    Attributes:
        variable_names: V names.
        valuations: int64 [S, V]; the completed state's are -1.
        action_names: A names.
        enabled: bool [S, A], the actions that were possible.
        logits: float64 [S, A], of all actions: their softmax over the enabled ones is the policy.
        probabilities: float64 [S, A], 0 where disabled.
    """

    variable_names: tuple[str, ...]
    valuations: Ints
    action_names: tuple[str, ...]
    enabled: Bools
    logits: Floats
    probabilities: Floats

    @property
    def acting(self) -> Bools:
        """bool [S], states in which something can be done."""
        acting: Bools = np.any(self.enabled, axis=1)
        return acting

    @property
    def with_end(self) -> Floats:
        """float64 [S, A + 1], the probabilities with those of `end`, for models on the canonical index."""
        return np.column_stack([self.probabilities, ~self.acting])


def tabulate(meta: MetaPolicy, models: Sequence[TabularMDP]) -> PolicyTable:
    """Return a policy as a table.

    Args:
        meta: the policy and its network.
        models: canonical models of one case; an action counts as enabled if it is in one of them.
    """
    first = models[0]
    enabled: Bools = np.any([model.enabled[:, :-1] for model in models], axis=0)
    with torch.no_grad():
        logits = action_logits(meta.network, meta.parameters).double()
        shares = log_policy(logits, torch.from_numpy(enabled)).exp().numpy()
    return PolicyTable(
        variable_names=first.variable_names,
        valuations=first.valuations,
        action_names=first.action_names[:-1],
        enabled=enabled,
        logits=logits.numpy(),
        probabilities=shares * enabled,
    )


def csv_text(table: PolicyTable) -> str:
    """Return a row for each state with an action: its variables, then each action's probability."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*table.variable_names, *table.action_names])
    rows = zip(
        table.valuations[table.acting].tolist(), table.probabilities[table.acting].tolist(), strict=True
    )
    writer.writerows([*valuation, *shares] for valuation, shares in rows)
    return stream.getvalue()


def npz_bytes(table: PolicyTable, case: CaseStudy, title: str) -> bytes:
    """Return the same rows as arrays that `numpy.load` reads; see docs/policies.md for their names."""
    stream = io.BytesIO()
    np.savez(
        stream,
        title=title,
        case=case.name,
        digest=case.digest,
        variables=np.array(table.variable_names),
        actions=np.array(table.action_names),
        locations=np.array(case.space.locations),
        modes=np.array(case.modes),
        valuations=table.valuations[table.acting],
        enabled=table.enabled[table.acting],
        logits=table.logits[table.acting],
        probabilities=table.probabilities[table.acting],
    )
    return stream.getvalue()


def prism_text(meta: MetaPolicy, system: Combination, title: str) -> str:
    """Return the Markov chain that a policy makes of a system; see `render_policy`.

    Args:
        meta: the policy and its network.
        system: a combination of the case, or a system that is met.
        title: one line that says which policy it is.

    Raises:
        ModelError: the system's model is unsound.
        EngineError: Storm failed.
    """
    whole = build_combination(system).mdp
    table = tabulate(meta, [canonical(system, whole)])
    chain = induced_chain(whole, _on_whole(whole, table))
    return render_policy(system, restrict_to_reachable(chain), title)


def _on_whole(whole: TabularMDP, table: PolicyTable) -> Floats:
    """Return float64 [S', A'], the policy on a whole model of Storm's, matched by valuation and name."""
    columns = align_variables(whole, (*table.variable_names, FLAG_VARIABLE))[:, :-1]
    row = match_rows(columns, table.valuations)
    row[whole.labels[COMPLETE_LABEL]] = len(table.valuations) - 1
    column = align_actions(whole, table.action_names)
    column[column < 0] = len(table.action_names)  # `end`
    policy: Floats = table.with_end[row[:, np.newaxis], column]
    return policy
