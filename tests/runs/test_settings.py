from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from merap.errors import InputError
from merap.learning.config import SAMPLED_DEFAULTS, TrainingConfig
from merap.runs.settings import read_config
from tests.support.paths import ROOT


def written(folder: Path, text: str) -> Path:
    path = folder / "settings.yaml"
    path.write_text(text)
    return path


def refused(file: Path | None, *words: str, **given: Any) -> str:
    with pytest.raises(InputError) as caught:
        read_config(file, words, **given)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_nothing_given_is_the_defaults() -> None:
    assert read_config(None, [], seed=None, updates=None) == TrainingConfig()


def test_later_sources_win(tmp_path: Path) -> None:
    file = written(tmp_path, "{updates: 1, seed: 1, episodes: 1, entropy: 0.5}")
    config = read_config(file, ["seed=2", "updates=2", "updates=3"], seed=4, updates=None)
    # entropy and episodes from the file, updates from the last word, seed from the option
    assert (config.entropy, config.episodes, config.updates, config.seed) == (0.5, 1, 3, 4)
    assert config.hidden == TrainingConfig().hidden


def test_words_are_yaml() -> None:
    config = read_config(None, ["hidden=[8, 4]", "activation=tanh", "learning_rate=1e-3", "order=1"])
    assert config.hidden == (8, 4)
    assert config.activation == "tanh"
    assert config.learning_rate == 0.001
    assert config.order == 1
    assert read_config(None, ["hidden=[]"]).hidden == ()


def test_a_setting_outlives_json() -> None:
    config = TrainingConfig(hidden=(3, 5), entropy=0.1, activation="tanh")
    assert TrainingConfig.model_validate_json(config.model_dump_json()) == config


def test_a_configuration_is_frozen() -> None:
    with pytest.raises(ValidationError):
        TrainingConfig().seed = 1


def test_an_unknown_setting_is_named_with_one_like_it(tmp_path: Path) -> None:
    line = refused(None, "udpates=3")
    assert line == "--set udpates=3: udpates: unknown setting; did you mean 'updates'?"
    file = written(tmp_path, "learning_rates: 0.1")
    line = refused(file)
    assert line.startswith(f"{file}: learning_rates: unknown setting")
    assert "'learning_rate'" in line


@pytest.mark.parametrize(
    ("word", "key"),
    [
        ("updates=0", "updates"),
        ("updates=many", "updates"),
        ("updates=", "updates"),
        ("updates=1.5", "updates"),
        ("seed=-1", "seed"),
        ("estimator=guess", "estimator"),
        ("order=3", "order"),
        ("activation=step", "activation"),
        ("baseline=magic", "baseline"),
        ("gae_lambda=1.1", "gae_lambda"),
        ("exploration=1", "exploration"),
        ("learning_rate=.inf", "learning_rate"),
        ("learning_rate=.nan", "learning_rate"),
        ("hidden=32", "hidden"),
        ("hidden=[0]", "hidden"),
        ("hidden=[8, -1]", "hidden"),
        ("hidden=[8, x]", "hidden"),
    ],
)
def test_a_value_that_is_not_allowed_is_named(word: str, key: str) -> None:
    line = refused(None, word)
    assert line.startswith(f"--set {word}: {key}")
    assert "got" in line


def test_a_wrong_value_tells_its_source(tmp_path: Path) -> None:
    file = written(tmp_path, "updates: 0")
    assert refused(file).startswith(f"{file}: updates: ")
    assert refused(None, updates=0).startswith("options: updates: ")


def test_a_wrong_value_is_an_error_even_where_a_later_source_wins(tmp_path: Path) -> None:
    assert "updates" in refused(written(tmp_path, "updates: 0"), "updates=3")


def test_a_word_without_equals_is_refused() -> None:
    assert refused(None, "updates") == "--set: expected key=value, got 'updates'"


@pytest.mark.parametrize("text", ["[1", "a: b: c", "'", "!!python/name:os.system x", "2001-99-99", "&a [*a"])
def test_a_value_that_is_not_yaml_is_refused(text: str) -> None:
    line = refused(None, f"hidden={text}")
    assert "hidden" in line
    assert line.startswith("--set")


def test_a_file_is_read_strictly(tmp_path: Path) -> None:
    missing = tmp_path / "nowhere.yaml"
    assert refused(missing) == f"{missing}: no such file"
    assert "settings.yaml:1: " in refused(written(tmp_path, "- updates"))
    assert "settings.yaml:2: " in refused(written(tmp_path, "seed: 1\nupdates: [1"))
    assert "settings.yaml:2" in refused(written(tmp_path, "updates: 1\nupdates: 2"))


def test_the_documentation_names_every_setting_and_its_default() -> None:
    page = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
    section = page.partition("## Settings")[2].partition("## Reading")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*?) (?:\(sampled: [^|]*\) )?\|", section, re.MULTILINE))
    for name, field in TrainingConfig.model_fields.items():
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        assert rows[name].lower() == str(default).lower(), name
    for name, default in SAMPLED_DEFAULTS.items():
        assert f"| `{name}` | {TrainingConfig.model_fields[name].default} (sampled: {default}) |" in page
