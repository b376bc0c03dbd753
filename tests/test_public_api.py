"""The library's face: names that `merap` and its folders export, loaded when they are first used."""

from __future__ import annotations

import pkgutil
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

import merap
from tests.support.paths import MODELS, ROOT

FOLDERS = [
    name
    for _, name, is_folder in pkgutil.iter_modules(merap.__path__)
    if is_folder and name not in {"cli", "program"}
]
FACES = [merap, *(import_module(f"merap.{name}") for name in FOLDERS)]
TEXTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
IMPORT = re.compile(r"^\s*from (merap[\w.]*) import (\w.*)$", re.MULTILINE)
RUNNING = str(MODELS / "running-example")
MAIN = "from merap.cli.main import main; main()"
HEAVY = ("torch", "numba", "stormpy", "matplotlib", "sqlalchemy", "alembic", "networkx", "httpx", "uvicorn")


def names(face: ModuleType) -> str:
    return face.__name__


@pytest.mark.parametrize("face", FACES, ids=names)
def test_every_public_name_is_there(face: ModuleType) -> None:
    assert face.__all__
    for name in face.__all__:
        assert getattr(face, name).__name__ == name
    assert dir(face) == sorted(face.__all__)


@pytest.mark.parametrize("face", FACES, ids=names)
def test_no_public_name_is_hidden_by_a_module(face: ModuleType) -> None:
    # importing `merap.x` sets the attribute `x` of `merap`
    modules = {module.name for module in pkgutil.iter_modules(face.__path__)}
    assert not modules & set(face.__all__)


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.name)
def test_all_that_a_page_imports_comes_from_merap_or_a_folder(page: Path) -> None:
    for module, imported in IMPORT.findall(page.read_text(encoding="utf-8")):
        face = import_module(module)
        assert face in FACES, f"{module} is private"
        assert set(imported.split(", ")) <= set(face.__all__), f"from {module} import {imported}"


def test_a_public_name_is_the_thing_itself() -> None:
    from merap.errors import MerapError  # noqa: PLC0415
    from merap.mdp.model import TabularMDP  # noqa: PLC0415

    assert merap.MerapError is MerapError
    assert merap.TabularMDP is TabularMDP


def test_another_name_is_not() -> None:
    with pytest.raises(AttributeError, match=r"No merap attribute trian"):
        merap.trian  # type: ignore[attr-defined]  # noqa: B018
    assert not hasattr(merap, "errorz")


def test_the_version_is_that_of_the_package() -> None:
    assert merap.__version__ == version("merap")
    assert re.fullmatch(r"\d+\.\d+\.\d+", merap.__version__)


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize(
    "program",
    [
        "import merap.mdp; merap.load_case",
        f"import merap; merap.load_case({RUNNING!r})",
        f"sys.argv[1:] = ['--version']; {MAIN}",
        f"sys.argv[1:] = ['validate', {RUNNING!r}]; {MAIN}",
        f"sys.argv[1:] = ['--help']; {MAIN}",
    ],
    ids=["name", "load", "version", "validate", "help"],
)
def test_looking_at_a_case_waits_for_nothing_heavy(program: str) -> None:
    told = f"atexit.register(lambda: print('heavy:', [name for name in {HEAVY} if name in sys.modules]))"
    done = subprocess.run(
        [sys.executable, "-c", f"import atexit, sys; {told}; {program}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.endswith("heavy: []\n")
