"""A training run in its folder: begin, or go on after an interruption."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

from merap.concerns.case_study import CaseStudy
from merap.families.build import build_base
from merap.families.folder import write_file
from merap.learning.checkpoint import (
    policy_bytes,
    read_checkpoint,
    read_policy,
    write_checkpoint,
    write_policy,
)
from merap.learning.config import TrainingConfig
from merap.learning.event_log import Log, event_log
from merap.learning.meta import MetaPolicy
from merap.learning.metrics import UpdateMetrics
from merap.learning.observation import case_kinds
from merap.learning.run_folder import RunFolder, Start, create_run, read_run, read_tasks, require_free
from merap.learning.tasks import TaskBatch, task_batch
from merap.learning.training import Outcome, TrainingState, meta_policy, outcome, updates
from merap.learning.warm_start import require_fit
from merap.mdp.model import TabularMDP

SECONDS_BETWEEN_CHECKPOINTS = 0.5
OUTCOME_FILE = "outcome.json"
EVENTS_FOLDER = "events"

OnUpdate = Callable[[UpdateMetrics], None]


def begin_run(
    path: Path, case: CaseStudy, config: TrainingConfig, source: RunFolder | None = None
) -> RunFolder:
    """Build the base of a case and make the folder of a run over it.

    Args:
        path: of the folder.
        case: to be learned.
        config: every setting.
        source: a finished run whose policy training begins with; None: random parameters.

    Raises:
        InputError: the source has not ended, or its policy does not fit the case.
        OutputError: `path` holds something, or can't be written.
        ModelError: a model is unsound.
        EngineError: Storm failed.
    """
    require_free(path)
    base = build_base(case, max_tasks=config.max_tasks, seed=config.seed)
    if source is None:
        return create_run(path, case, base, config)
    meta = read_policy(source, tasks_of(source))
    require_fit(meta, source.case, case, batch_of(case, base.models), config)
    start = Start(policy_bytes(meta), source.case.name, source.case.digest)
    return create_run(path, case, base, config, start)


def tasks_of(run: RunFolder) -> TaskBatch:
    """The tasks of a run, from its archives."""
    return batch_of(run.case, read_tasks(run))


def batch_of(case: CaseStudy, models: Sequence[TabularMDP]) -> TaskBatch:
    """Canonical models of a case as tasks."""
    horizon = case.combination_at(0).objective.horizon
    return task_batch(models, horizon, case.discount, kinds=case_kinds(case.space, len(case.modes)))


@dataclass(frozen=True, eq=False)
class Trained:
    """What training has led to.

    Attributes:
        policy: the meta policy, as it is in the folder.
        outcome: how the run ended.
    """

    policy: MetaPolicy
    outcome: Outcome


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


def _log(run: RunFolder, state: TrainingState) -> AbstractContextManager[Log]:
    if run.config.tensorboard:
        return event_log(run.path / EVENTS_FOLDER, state.update + 1)
    return nullcontext(lambda metrics: None)


def train(
    case: CaseStudy,
    path: Path,
    config: TrainingConfig | None = None,
    on_update: OnUpdate = lambda metrics: None,
    source: RunFolder | None = None,
) -> RunFolder:
    """Train a meta policy for a case into a new folder; raises as `begin_run`.

    It begins at random parameters, or with the source's policy. Where no settings are given they are those
    of the source, or the defaults.
    """
    settings = config or (TrainingConfig() if source is None else source.config)
    run = begin_run(path, case, settings, source)
    train_run(run, on_update)
    return run


def resume(path: Path, on_update: OnUpdate = lambda metrics: None) -> RunFolder:
    """Go on with a run that was interrupted, bit for bit as if it had not been.

    Raises:
        InputError: `path` is not the folder of a run.
    """
    run = read_run(path)
    train_run(run, on_update)
    return run
