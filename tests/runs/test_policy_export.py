from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.special import softmax

from merap.checker.storm import build_text
from merap.concerns.lookup import declared_case
from merap.families.models import built
from merap.learning.config import TrainingConfig
from merap.learning.meta import MetaPolicy
from merap.learning.policy import policy_table
from merap.mdp.evaluation import expected_return
from merap.runs.checkpoint import read_policy
from merap.runs.policy_export import csv_text, npz_bytes, prism_text, tabulate
from merap.runs.policy_on_index import on_index
from merap.runs.run_folder import RunFolder, read_base
from merap.runs.train import batch_of, tasks_of
from merap.strategies.adaptation import adapt
from merap.strategies.adapted_policy import adapted_policy
from tests.support.paths import MODELS
from tests.support.trained_runs import SMALL, trained

RUNNING_EXAMPLE = MODELS / "running-example"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Modes, slip and disabled actions; its met systems are built in part only."""
    config = TrainingConfig(updates=4, episodes=5)
    return trained(tmp_path_factory.mktemp("runs") / "run", config, RUNNING_EXAMPLE)


@pytest.fixture(scope="module")
def meta(run: RunFolder) -> MetaPolicy:
    return read_policy(run, tasks_of(run))


def test_a_table_holds_what_the_learner_computes(run: RunFolder, meta: MetaPolicy) -> None:
    models = read_base(run).models
    table = tabulate(meta, models[:1])
    enabled = torch.from_numpy(models[0].enabled[:, :-1])
    with torch.no_grad():
        expected = policy_table(meta.network, meta.parameters, enabled).numpy()
    np.testing.assert_allclose(table.probabilities, expected, atol=1e-6)
    np.testing.assert_allclose(table.with_end.sum(axis=1), 1, atol=1e-12)
    everything = tabulate(meta, models)
    assert (everything.enabled >= table.enabled).all()


def test_csv_is_the_table_in_plain_text(run: RunFolder, meta: MetaPolicy) -> None:
    table = tabulate(meta, read_base(run).models)
    rows = list(csv.reader(io.StringIO(csv_text(table, run.case))))
    assert rows[0] == ["loc", "mode", *run.case.actions]
    case = declared_case(run.case)
    assert [row[:2] for row in rows[1:]] == [
        [case.space.locations[location], case.modes[mode]]
        for location, mode in table.valuations[table.acting].tolist()
    ]
    shares = np.array([row[2:] for row in rows[1:]], dtype=np.float64)
    np.testing.assert_array_equal(shares, table.probabilities[table.acting])


def test_npz_tells_everything_without_pickle(run: RunFolder, meta: MetaPolicy) -> None:
    table = tabulate(meta, read_base(run).models)
    loaded = np.load(io.BytesIO(npz_bytes(table, run.case, "a title")), allow_pickle=False)
    assert str(loaded["case"]) == run.case.name
    assert str(loaded["digest"]) == run.case.digest
    assert str(loaded["title"]) == "a title"
    assert tuple(loaded["actions"]) == run.case.actions
    assert tuple(loaded["variables"]) == ("loc", "mode")
    case = declared_case(run.case)
    assert tuple(loaded["values_loc"]) == case.space.locations
    assert tuple(loaded["values_mode"]) == case.modes
    masked = np.where(loaded["enabled"], loaded["logits"], -np.inf)
    np.testing.assert_allclose(softmax(masked, axis=1), loaded["probabilities"], atol=1e-12)
    np.testing.assert_array_equal(loaded["probabilities"] > 0, loaded["enabled"])


def test_the_same_policy_gives_the_same_bytes(run: RunFolder, meta: MetaPolicy) -> None:
    table = tabulate(meta, read_base(run).models)
    assert npz_bytes(table, run.case, "a title") == npz_bytes(table, run.case, "a title")


@pytest.mark.parametrize("system", ["met", "b_blocked.speed_high.g3"])
def test_storm_gives_the_chain_the_value_of_the_policy(run: RunFolder, meta: MetaPolicy, system: str) -> None:
    """Storm on the text alone, against backward recursion on the model with the policy: two routes."""
    met, base = run.case.system(system), read_base(run)
    chain = build_text(prism_text(meta, base, met, "the meta policy"), "policy")
    model = base.index.place(built(met))
    policy = tabulate(meta, [model]).with_end
    horizon = met.objective.horizon
    for discount, bound in ((1.0, f"C<={horizon}"), (met.discount, f"C<={horizon}discount={met.discount}")):
        value = chain.check(f'R{{"objective"}}=? [{bound}]').value
        assert value == pytest.approx(expected_return(model, policy, horizon, discount), abs=1e-9)


def test_an_adapted_policy_is_the_one_that_adapting_ends_with(run: RunFolder) -> None:
    met = run.case.system("met")
    meta, _ = adapted_policy(run, met, steps=2, episodes_per_step=4, seed=3)
    found = adapt(run, met, strategy="gradient", steps=2, episodes_per_step=4, seeds=[3])
    ours = tabulate(meta, [found.model]).with_end
    reachable = found.model.reachable
    np.testing.assert_allclose(ours[reachable], found.after[reachable], atol=1e-6)
    assert np.abs(found.before - found.after).max() > 1e-4


def test_no_step_leaves_the_meta_policy(run: RunFolder, meta: MetaPolicy) -> None:
    same, _ = adapted_policy(run, run.case.system("met"), steps=0)
    assert all(torch.equal(same.parameters[name], value) for name, value in meta.parameters.items())


@pytest.mark.parametrize("case", ["web-service", "families/pump.yaml"])
def test_a_policy_of_any_family_can_be_taken_away(tmp_path: Path, case: str) -> None:
    """Storm on the text, against the table on the model: no locations, flags, names of values."""
    run = trained(tmp_path / "run", SMALL, MODELS / case)
    base, met = read_base(run), run.case.system("met")
    meta = read_policy(run, batch_of(base))
    chain = build_text(prism_text(meta, base, met, "the meta policy"), "policy")
    index = base.index.extended(built(met))
    model = index.place(built(met))
    policy = tabulate(on_index(meta, base.index, index, base.kinds), [model]).with_end
    value = chain.check(f'R{{"objective"}}=? [C<={met.objective.horizon}]').value
    assert value == pytest.approx(expected_return(model, policy, met.objective.horizon), abs=1e-9)
