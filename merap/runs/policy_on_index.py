"""Put a policy on another index: for a base with other states, or a system that has some of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from merap.families.observation import VariableKind, observation_features
from merap.learning.meta import MetaPolicy
from merap.mdp.index import FamilyIndex

# The weights of which a state that is observed one-hot has a row.
ROWS = "layer0.weight"


def on_index(
    meta: MetaPolicy,
    source: FamilyIndex,
    target: FamilyIndex,
    kinds: Sequence[VariableKind] | None = None,
) -> MetaPolicy:
    """Return a meta policy on another index of its family: it acts alike in the states that both hold.

    Args:
        meta: a policy for the states of `source`.
        source: its index.
        target: the other index. Weights of a state that `source` lacks are 0, if states are observed one-hot.
        kinds: of the variables, for features of the states that `source` lacks; None: these are 0.

    Raises:
        ModelError: a value of `target` is out of its variable's range.
    """
    numbers = torch.from_numpy(target.numbers_on(source))
    known = (numbers >= 0).unsqueeze(1)
    network = replace(meta.network, num_states=target.num_states, features=None)
    if meta.network.features is None:
        rows = {ROWS: meta.parameters[ROWS][numbers] * known}
        return replace(meta, network=network, parameters=meta.parameters | rows)
    features = meta.network.features[numbers] * known
    if kinds is not None:
        found = observation_features(kinds, target.valuations, target.is_completed)
        features = torch.from_numpy(found).to(features.dtype)
    return replace(meta, network=replace(network, features=features))
