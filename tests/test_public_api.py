from __future__ import annotations

import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

import merap
import merap.knowledge
import merap.mdp
import merap.systems

FACES = [merap, merap.knowledge, merap.mdp, merap.systems]


@pytest.mark.parametrize("face", FACES)
def test_every_public_name_is_there(face: ModuleType) -> None:
    assert face.__all__
    for name in face.__all__:
        assert getattr(face, name).__name__ == name
    assert dir(face) == sorted(face.__all__)


@pytest.mark.parametrize("face", FACES)
def test_no_public_name_is_hidden_by_a_module(face: ModuleType) -> None:
    # importing `merap.x` sets the attribute `x` of `merap`
    modules = {module.name for module in pkgutil.iter_modules(face.__path__)}
    assert not modules & set(face.__all__)


def test_a_public_name_is_the_thing_itself() -> None:
    from merap.errors import MerapError  # noqa: PLC0415
    from merap.mdp.model import TabularMDP  # noqa: PLC0415

    assert merap.MerapError is MerapError
    assert merap.TabularMDP is TabularMDP


def test_another_name_is_not() -> None:
    with pytest.raises(AttributeError, match=r"No merap attribute trian"):
        merap.trian  # type: ignore[attr-defined]  # noqa: B018
    assert not hasattr(merap, "errorz")


@pytest.mark.slow
def test_looking_at_a_case_waits_for_nothing_slow() -> None:
    slow = ("torch", "matplotlib", "stormpy")
    program = f"import sys, merap.mdp; merap.load_case; print([n for n in {slow} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
