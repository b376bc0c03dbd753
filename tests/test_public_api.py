from __future__ import annotations

import subprocess
import sys

import pytest

import merap


def test_every_public_name_is_there() -> None:
    for name in merap.__all__:
        assert getattr(merap, name).__name__ == name
    assert dir(merap) == sorted(merap.__all__)


def test_a_public_name_is_the_thing_itself() -> None:
    from merap.errors import MerapError  # noqa: PLC0415
    from merap.mdp.model import TabularMDP  # noqa: PLC0415

    assert merap.MerapError is MerapError
    assert merap.TabularMDP is TabularMDP


def test_another_name_is_not() -> None:
    with pytest.raises(AttributeError, match=r"module 'merap' has no attribute 'trian'"):
        merap.trian  # noqa: B018
    assert not hasattr(merap, "errorz")


@pytest.mark.slow
def test_looking_at_a_case_waits_for_nothing_slow() -> None:
    slow = ("torch", "matplotlib", "stormpy")
    program = f"import sys, merap; merap.load_case; print([name for name in {slow} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
