"""Policies to take away: as tables that need no torch, and as PRISM text that needs nothing of ours.

Axes: S states of the index, A declared actions, V state variables.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from merap.concerns.case_study import CaseStudy
from merap.concerns.combination import Combination
from merap.families.build import ModelBase
from merap.families.models import built
from merap.learning.meta import MetaPolicy
from merap.learning.policy import action_logits, log_policy
from merap.mdp.alignment import align_actions
from merap.mdp.chain import induced_chain
from merap.mdp.graph import restrict_to_reachable
from merap.mdp.index import FamilyIndex
from merap.mdp.model import Bools, Floats, Ints, TabularMDP
from merap.prism.rendering import render_policy
from merap.program.form import StateVariable
from merap.runs.policy_on_index import on_index


@dataclass(frozen=True, eq=False)
class PolicyTable:
    """What a policy does in every state.

    Attributes:
        variable_names: V names.
        valuations: int64 [S, V]; those of completed states mean nothing.
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
        """float64 [S, A + 1], the probabilities with those of `end`, for models on the index."""
        return np.column_stack([self.probabilities, ~self.acting])


def tabulate(meta: MetaPolicy, models: Sequence[TabularMDP]) -> PolicyTable:
    """Return a policy as a table.

    Args:
        meta: the policy and its network.
        models: on one index; an action counts as enabled if it is in one of them.
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


def tabulate_on(meta: MetaPolicy, base: ModelBase, system: Combination | None = None) -> PolicyTable:
    """Return a policy as a table for a system; None: for all tasks of its base.

    Raises:
        ModelError: the system's model is unsound.
        EngineError: Storm failed.
    """
    if system is None:
        return tabulate(meta, base.models)
    return _on_system(meta, base, built(system))[0]


def _on_system(meta: MetaPolicy, base: ModelBase, whole: TabularMDP) -> tuple[PolicyTable, FamilyIndex]:
    index = base.index.extended(whole)
    return tabulate(on_index(meta, base.index, index, base.kinds), [index.place(whole)]), index


def csv_text(table: PolicyTable, case: CaseStudy) -> str:
    """Return a row for each state with an action: its variables, then each action's probability."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*table.variable_names, *table.action_names])
    variables = _variables(table, case)
    rows = zip(
        table.valuations[table.acting].tolist(), table.probabilities[table.acting].tolist(), strict=True
    )
    for valuation, shares in rows:
        shown = (one.text(value) for one, value in zip(variables, valuation, strict=True))
        writer.writerow([*shown, *shares])
    return stream.getvalue()


def _variables(table: PolicyTable, case: CaseStudy) -> list[StateVariable]:
    by_name = {one.name: one for one in case.combination_at(0).program.variables}
    return [by_name[name] for name in table.variable_names]


def npz_bytes(table: PolicyTable, case: CaseStudy, title: str) -> bytes:
    """Return the same rows as arrays that `numpy.load` reads; see docs/policies.md for their names."""
    stream = io.BytesIO()
    named = [one for one in _variables(table, case) if one.kind == "named"]
    np.savez(
        stream,
        title=title,
        case=case.name,
        digest=case.digest,
        variables=np.array(table.variable_names),
        actions=np.array(table.action_names),
        valuations=table.valuations[table.acting],
        enabled=table.enabled[table.acting],
        logits=table.logits[table.acting],
        probabilities=table.probabilities[table.acting],
        allow_pickle=False,
        **{f"values_{one.name}": np.array(one.values) for one in named},
    )
    return stream.getvalue()


def prism_text(meta: MetaPolicy, base: ModelBase, system: Combination, title: str) -> str:
    """Return the Markov chain that a policy makes of a system; see `render_policy`.

    Args:
        meta: the policy and its network.
        base: that it was learned for.
        system: a combination of the case, or a system that is met.
        title: one line that says which policy it is.

    Raises:
        ModelError: the system's model is unsound.
        EngineError: Storm failed.
    """
    whole = built(system)
    table, index = _on_system(meta, base, whole)
    column = align_actions(whole, table.action_names)
    column[column < 0] = len(table.action_names)  # `end`
    policy: Floats = table.with_end[index.number(whole)[:, np.newaxis], column]
    return render_policy(system, restrict_to_reachable(induced_chain(whole, policy)), title)
