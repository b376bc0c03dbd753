"""A training run in its folder: begin, or go on after an interruption."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from merap.concerns.arguments import as_mapping, as_path
from merap.concerns.case_study import CaseStudy
from merap.errors import InputError, warn_of
from merap.families.build import ModelBase, build_base
from merap.families.folder import MANIFEST, write_file
from merap.families.lookup import as_case
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy
from merap.learning.progress import UpdateMetrics
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.training import TrainingOutcome, TrainingState, meta_policy, outcome, updates
from merap.runs.checkpoint import (
    POLICY_FILE,
    policy_bytes,
    read_checkpoint,
    read_policy,
    write_checkpoint,
    write_policy,
)
from merap.runs.event_log import Log, event_log
from merap.runs.run_folder import (
    RunFolder,
    Start,
    as_run,
    create_run,
    read_base,
    read_manifest,
    read_run,
    require_free,
)
from merap.runs.settings import read_config
from merap.runs.warm_start import fitted

SECONDS_BETWEEN_CHECKPOINTS = 0.5
OUTCOME_FILE = "outcome.json"
EVENTS_FOLDER = "events"

OnUpdate = Callable[[UpdateMetrics], None]


def begin_run(
    path: Path,
    case: CaseStudy,
    config: TrainingConfig,
    source: RunFolder | None = None,
    on_model: Callable[[], None] = lambda: None,
) -> RunFolder:
    """Build the base of a case and make the folder of a run over it.

    Args:
        path: of the folder.
        case: to be learned.
        config: every setting.
        source: a finished run whose policy training begins with; None: random parameters.
        on_model: called after each model that is built.

    Raises:
        InputError: the source has not ended, or its policy does not fit the case.
        OutputError: `path` holds something, or can't be written.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    require_free(path)
    base = build_base(case, max_tasks=config.max_tasks, seed=config.seed, on_model=on_model)
    if source is None:
        return create_run(path, case, base, config)
    learned = read_base(source)
    meta = fitted(read_policy(source, batch_of(learned)), learned, base, batch_of(base), config)
    start = Start(policy_bytes(meta), source.case.name, source.case.digest)
    return create_run(path, case, base, config, start)


def tasks_of(run: RunFolder) -> TaskBatch:
    """Return the tasks of a run, from its archives."""
    return batch_of(read_base(run))


def batch_of(base: ModelBase) -> TaskBatch:
    """Return the models of a base as tasks."""
    return task_batch(base.models, base.horizons, base.discount, kinds=base.kinds)


@dataclass(frozen=True, eq=False)
class Trained:
    """What training has led to.

    Attributes:
        policy: the meta policy, as it is in the folder.
        outcome: how the run ended.
    """

    policy: MetaPolicy
    outcome: TrainingOutcome


def train_run(run: RunFolder, on_update: OnUpdate = lambda metrics: None) -> Trained:
    """Train from the run's last checkpoint, or from the beginning, to the end.

    A checkpoint is written at least every second where an update takes less than half of one.

    Args:
        run: the folder.
        on_update: called after each update.

    Raises:
        InputError: the folder's files don't fit, or a setting does not fit the case.
        ModelError: the gradient is no number before anything was learned.
    """
    tasks = tasks_of(run)
    state, metrics = read_checkpoint(run, tasks)
    written = time.monotonic()
    with _log(run, state) as log:
        for row in updates(tasks, run.config, state):
            metrics.append(row)
            log(row)
            on_update(row)
            if time.monotonic() - written > SECONDS_BETWEEN_CHECKPOINTS:
                write_checkpoint(run, state, metrics)
                written = time.monotonic()
    write_checkpoint(run, state, metrics)
    trained = Trained(meta_policy(tasks, run.config, state), outcome(run.config, state))
    write_file(run.path / OUTCOME_FILE, json.dumps(asdict(trained.outcome), indent=2) + "\n", force=True)
    # last: with the policy a run has ended
    write_policy(run, trained.policy)
    return trained


def lengthen(run: RunFolder, updates: int) -> RunFolder:
    """Let a run, finished or not, go on to a greater number of updates.

    From where it is its schedules are those of a run of that length. Until it gets there it counts as not
    finished.

    Raises:
        InputError: the run is to have more updates already.
        OutputError: the folder can't be written.
    """
    config = read_config(None, [], run.config, updates=updates)
    if config.updates < run.config.updates:
        raise InputError(
            f"the run has {run.config.updates}; expected more, got {config.updates}", source="updates"
        )
    if config.updates > run.config.updates:
        content = {**read_manifest(run.path), "config": config.model_dump(mode="json")}
        write_file(run.path / MANIFEST, json.dumps(content, indent=2) + "\n", force=True)
        (run.path / POLICY_FILE).unlink(missing_ok=True)
    return replace(run, config=config)


def _log(run: RunFolder, state: TrainingState) -> AbstractContextManager[Log]:
    if run.config.tensorboard:
        return event_log(run.path / EVENTS_FOLDER, state.update + 1)
    return nullcontext(lambda metrics: None)


def train(
    case: CaseStudy | str | PathLike[str],
    path: str | PathLike[str],
    config: TrainingConfig | Mapping[str, Any] | None = None,
    on_update: OnUpdate = lambda metrics: None,
    source: RunFolder | str | PathLike[str] | None = None,
    **settings: Any,
) -> RunFolder:
    """Train a meta policy for a case into a new folder.

    Args:
        case: to be learned, or its path.
        path: of the folder.
        config: settings; None: those of the source, or the defaults.
        on_update: called after each update.
        source: a finished run whose policy training begins with, or its path; None: random parameters.
        **settings: single settings, which win over `config`.

    Raises:
        InputError: an argument is wrong, or as `begin_run`.
        OutputError: `path` holds something, or can't be written.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    begun_from = None if source is None else as_run(source)
    base = None if begun_from is None else begun_from.config
    if config is not None:
        base = (
            config if isinstance(config, TrainingConfig) else TrainingConfig(**as_mapping(config, "config"))
        )
    chosen = read_config(None, [], base, **settings)
    run = begin_run(as_path(path, "path"), as_case(case), chosen, begun_from)
    warn_of(run.warnings)
    train_run(run, on_update)
    return run


def resume(
    path: str | PathLike[str], on_update: OnUpdate = lambda metrics: None, *, updates: int | None = None
) -> RunFolder:
    """Go on with a run that was interrupted, bit for bit as if it had not been, or lengthen one.

    Args:
        path: the folder of the run.
        on_update: called after each update.
        updates: number of updates to go on to; None: as many as the run was begun with.

    Raises:
        InputError: `path` is not the folder of a run, or the run has more updates.
    """
    run = read_run(path)
    if updates is not None:
        run = lengthen(run, updates)
    train_run(run, on_update)
    return run
