from __future__ import annotations

import pytest

from merap.errors import InputError
from merap.program.names import KEYWORDS, MAX_NAME_LENGTH, check_name, unique_name


@pytest.mark.parametrize("name", ["a-b", "1a", "", "ä", "a\n", "a b", "a" * (MAX_NAME_LENGTH + 1)])
def test_what_is_no_name(name: str) -> None:
    with pytest.raises(InputError):
        check_name(name, "an action")


@pytest.mark.parametrize("name", ["stop", "up", "_x", "Open", "start_x", "a1", "system", "G"])
def test_names(name: str) -> None:
    check_name(name, "an action")


def test_names_that_are_taken_get_underscores() -> None:
    assert unique_name("shift", {"shift", "shift_"}) == "shift__"
    assert unique_name("up", {"shift"}) == "up"
    assert all(unique_name(name, set()) == f"{name}_" for name in KEYWORDS)
