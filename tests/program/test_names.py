from __future__ import annotations

import re
from pathlib import Path

import pytest

from merap.concerns.case_study import load_case
from merap.errors import InputError
from merap.prism.rendering import render
from merap.program.names import KEYWORDS, RESERVED, RESERVED_PREFIXES, check_emitted_name
from tests.support.case_examples import GRAPH, write_case


def test_what_prism_text_declares_is_reserved(tmp_path: Path) -> None:
    """The text is the second source: every identifier it declares, except the user's own, is reserved."""
    combination = load_case(write_case(tmp_path, GRAPH)).combination_at(0)
    text = render(combination)
    declared = set(
        re.findall(r"^(?:formula|module|const double|label|rewards) \"?(\w+)\"?", text, re.MULTILINE)
    )
    declared |= set(re.findall(r"^ +(\w+) : (?:\[|bool)", text, re.MULTILINE))
    assert {"complete", "space", "goal", "objective", "loc", "mode", "done"} <= declared
    free = {name for name in declared if name not in RESERVED and not name.startswith(RESERVED_PREFIXES)}
    attributes = [attribute.name for attribute in combination.environment.attributes]
    assert {"light", "light_east"} <= free
    assert {name for name in free if not name.startswith(tuple(attributes))} == set()


@pytest.mark.parametrize(
    "name", sorted(KEYWORDS | RESERVED | {"start_x", "open_x", "pay_up", "a-b", "1a", "", "ä", "a\n"})
)
def test_names_that_cannot_be_emitted(name: str) -> None:
    with pytest.raises(InputError, match="illegal name"):
        check_emitted_name(name, "an action")


@pytest.mark.parametrize("name", ["stop", "up", "_x", "Open", "restart", "a1"])
def test_names_that_can_be_emitted(name: str) -> None:
    check_emitted_name(name, "an action")
