"""Settings of a trigger from a file."""

from __future__ import annotations

from typing import Any

import pytest

from merap.errors import InputError
from merap.online.trigger.change import ChangeTrigger
from merap.online.trigger.making import make_trigger
from merap.online.trigger.settings import ChangeSettings, NoTrigger, WindowSettings, read_trigger
from merap.online.trigger.window import WindowTrigger


def test_each_kind_makes_its_trigger() -> None:
    assert isinstance(make_trigger(read_trigger("change", {})), ChangeTrigger)
    assert isinstance(make_trigger(read_trigger("window", {"threshold": 3})), WindowTrigger)
    assert make_trigger(read_trigger("none", {})) is None


def test_what_is_given_counts_and_the_rest_is_default() -> None:
    settings = read_trigger("change", {"noise": 0.5, "odds": [2, 20]})
    assert settings == ChangeSettings(noise=0.5, odds=(2.0, 20.0))
    assert read_trigger("window", {"threshold": -1, "steps": 18}) == WindowSettings(threshold=-1.0, steps=18)
    assert read_trigger("none", {}) == NoTrigger()


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        ("chance", {}, "'chance'"),
        ("window", {}, "trigger.threshold: Field required"),
        (
            "window",
            {"threshold": 1, "discount": 0},
            "trigger.discount: Input should be greater than 0, got 0",
        ),
        ("change", {"noise": 0}, "trigger.noise: Input should be greater than 0, got 0"),
        ("change", {"nose": 1}, "trigger.nose: Extra inputs are not permitted, got 1"),
        ("change", {"odds": [0.5]}, r"trigger.odds.0: Input should be greater than or equal to 1, got 0.5"),
        ("change", {"odds": []}, "trigger.odds"),
        ("change", {"release": 1}, "trigger.release: Input should be less than 1, got 1"),
        ("change", {"noise": float("inf")}, "trigger.noise: Input should be a finite number, got inf"),
        ("none", {"noise": 1}, "trigger.noise: Extra inputs are not permitted"),
    ],
)
def test_what_is_not_allowed_is_named(kind: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_trigger(kind, given)
