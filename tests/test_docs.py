"""What README and docs show is run: Python blocks, `$ merap` lines, and the files that are named."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest

from merap.checker.verdicts import verify
from merap.families.loading import load_case
from tests.support.command_line import merap
from tests.support.paths import ROOT

TEXTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


@pytest.mark.slow
@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_examples_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    for block in (one for language in ("yaml", "prism", "jinja") for one in blocks(path, language)):
        if (name := re.match(r"(?:#|//|\{#) (\w+(?:\.\w+)+)( #\})?\n", block)) is not None:
            (tmp_path / name[1]).write_text(block, encoding="utf-8")
    for index, block in enumerate(blocks(path, "python")):
        program = tmp_path / f"example_{index}.py"
        program.write_text(block, encoding="utf-8")
        runpy.run_path(str(program), run_name="__main__")
    for block in blocks(path, "console"):
        for line in block.splitlines():
            if line.startswith("$ merap "):
                done = merap(*shlex.split(line)[2:])
                assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def test_the_case_of_the_docs_is_as_described(tmp_path: Path) -> None:
    page = ROOT / "docs" / "case-file.md"
    text = next(block for block in blocks(page, "yaml") if block.startswith("case:"))
    (tmp_path / "case.yaml").write_text(text, encoding="utf-8")
    case = load_case(tmp_path)
    assert case.size == 4
    false = [verdict for verdict in verify(case.combinations()) if verdict.holds is False]
    names = [verdict.combination for verdict in false]
    assert names == ["hall_blocked.worn.to_shelf", "hall_blocked.new.to_shelf"]
    first = false[0]
    line = f"{first.combination}: {first.name} ({first.property}) does not hold: {first.reason}"
    assert line in page.read_text(encoding="utf-8")


def prose(path: Path) -> str:
    """Return a page without code blocks."""
    return re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    """Return the anchors of a page's headings, made as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", prose(path), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", prose(path)):
        page = path.parent / target if target else path
        assert page.is_file(), target
        assert not anchor or anchor in anchors(page), f"{target}#{anchor}"


@pytest.mark.parametrize("path", TEXTS[1:], ids=lambda path: path.name)
def test_a_page_begins_with_its_purpose_in_plain_sentences(path: Path) -> None:
    text = prose(path)
    assert re.match(r"# .+\n\nThis page ", text)
    assert not re.search(r"(^|[.:;]\s)(Of|Which|So many) ", text, re.MULTILINE)
