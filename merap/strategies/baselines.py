"""The trained baselines of the paper: learned once, on demand, and kept in the run folder.

    baselines/joint.safetensors                        one policy for all tasks
    baselines/pretrained/<combination>.safetensors     a policy for one combination

Each file has its recipe; one with another recipe is refused, never used or written over.

Axes: N tasks, S states, A declared actions.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from merap.errors import InputError
from merap.families.folder import write_bytes
from merap.learning.policy import (
    Parameters,
    PolicyNetwork,
    initial_parameters,
    policy_table,
    stack_parameters,
)
from merap.learning.tasks import TaskBatch
from merap.mdp.model import Floats
from merap.runs.run_folder import RunFolder
from merap.strategies.policy_search import SearchSettings, joint_parameters, separate_parameters

FOLDER = "baselines"
JOINT_FILE = "joint.safetensors"
PRETRAINED_FOLDER = "pretrained"
# Policies that are searched for side by side: enough to be fast, and few enough to fit in memory.
SIDE_BY_SIDE = 64
_RECIPE = "recipe"


def joint_policy(run: RunFolder, network: PolicyNetwork, tasks: Callable[[], TaskBatch]) -> Floats:
    """Return one policy for all tasks of a run; learn it if it is not stored.

    Args:
        run: the run.
        network: the shape of its policies.
        tasks: its tasks; asked for if the policy has not been learned before.

    Returns:
        float64 [S, A].

    Raises:
        InputError: a stored file does not fit.
    """
    path = run.path / FOLDER / JOINT_FILE
    settings = SearchSettings(seed=run.config.seed)
    recipe = _recipe(run, settings, tasks=len(run.names))
    parameters = _stored(path, network, recipe)
    if parameters is None:
        parameters = joint_parameters(network, tasks(), settings)
        _store(path, parameters, recipe)
    return _table(network, parameters)


def pretrained_policies(
    run: RunFolder,
    network: PolicyNetwork,
    names: Sequence[str],
    tasks: Callable[[Sequence[str]], TaskBatch],
) -> list[Floats]:
    """Return policies for some combinations, each learned on its own model alone.

    Args:
        run: the run.
        network: the shape of its policies.
        names: names of the combinations.
        tasks: their models; asked for those that have not been learned before.

    Returns:
        float64 [S, A] for each name.

    Raises:
        InputError: a stored file does not fit.
    """
    settings = SearchSettings(seed=run.config.seed)
    folder = run.path / FOLDER / PRETRAINED_FOLDER
    paths = {name: folder / f"{name}.safetensors" for name in names}
    recipes = {name: _recipe(run, settings, combination=name) for name in names}
    found = {name: _stored(paths[name], network, recipes[name]) for name in names}
    missing = [name for name in paths if found[name] is None]
    for first in range(0, len(missing), SIDE_BY_SIDE):
        chunk = missing[first : first + SIDE_BY_SIDE]
        learned = separate_parameters(network, tasks(chunk), settings)
        for number, name in enumerate(chunk):
            own = {key: value[number].contiguous() for key, value in learned.items()}
            _store(paths[name], own, recipes[name])
            found[name] = own
    return [_table(network, parameters) for parameters in found.values() if parameters is not None]


def _recipe(run: RunFolder, settings: SearchSettings, **content: Any) -> Mapping[str, Any]:
    """Return the recipe of a baseline, as JSON has it."""
    made_from: Mapping[str, Any] = json.loads(
        json.dumps({"case": run.case.digest, **asdict(settings), **content})
    )
    return made_from


def _store(path: Path, parameters: Parameters, recipe: Mapping[str, Any]) -> None:
    # force: a file that appeared meanwhile is by another process, from the same recipe
    write_bytes(path, save(parameters, {_RECIPE: json.dumps(recipe)}), force=True)


def _stored(path: Path, network: PolicyNetwork, recipe: Mapping[str, Any]) -> Parameters | None:
    """Return the parameters in a file; None if there is no file.

    Raises:
        InputError: the file is damaged, or has another recipe.
    """
    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            made_from = json.loads((file.metadata() or {}).get(_RECIPE, "null"))
            parameters = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"can't be read ({error}); remove it to learn the policy anew", source=str(path)
        ) from error
    if made_from != recipe:
        raise InputError(
            f"was made from something else ({_difference(made_from, recipe)}); "
            "remove it to learn the policy anew",
            source=str(path),
        )
    fresh = initial_parameters(network, torch.Generator())
    shapes = {name: (value.shape, value.dtype) for name, value in parameters.items()}
    if shapes != {name: (value.shape, value.dtype) for name, value in fresh.items()}:
        raise InputError(
            "holds a policy of another shape; remove it to learn the policy anew", source=str(path)
        )
    return parameters


def _difference(made_from: Any, recipe: Mapping[str, Any]) -> str:
    """Return the first entry in which a recipe differs from the requested one."""
    if not isinstance(made_from, dict):
        return "it says not what"
    keys = [*recipe, *(key for key in made_from if key not in recipe)]
    key = next(key for key in keys if made_from.get(key) != recipe.get(key))
    return f"{key} {made_from.get(key)!r}, not {recipe.get(key)!r}"


def _table(network: PolicyNetwork, parameters: Parameters) -> Floats:
    """Return float64 [S, A], with every action enabled."""
    enabled = torch.ones(1, network.num_states, network.num_actions, dtype=torch.bool)
    with torch.no_grad():
        table: Floats = policy_table(network, stack_parameters(parameters, 1), enabled)[0].double().numpy()
    return table
