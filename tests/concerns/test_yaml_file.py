"""Files that are no readable YAML: one clear line each."""

from __future__ import annotations

from pathlib import Path

import pytest

from merap.concerns.case_study import load_declared_case
from merap.concerns.yaml_file import MAX_BYTES, read_document, read_value
from merap.errors import InputError
from tests.support.case_examples import write_case


def billion_laughs(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        (b"case: x\nspace: [1, 2\nonline: {}\n", 3, "YAML: expected ',' or ']'"),
        (b"case: x\n\tspace: 1\n", 2, "YAML: found character '\\t'"),
        (b"case: x\nspace: \x00\n", 2, "YAML: special characters are not allowed"),
        (b"case: x\ncase: y\n", 2, "the key 'case' stands twice"),
        (b"case: x\nspace:\n  name: caf\xe9\n", 3, "is not UTF-8"),
        (b"\xff\xfec\x00", 1, "is not UTF-8"),
        (b"- case\n- x\n", 1, "expected a mapping of keys to values at the top level"),
        (b"", 1, "expected a mapping of keys to values at the top level"),
        (b"case: x\n---\ncase: y\n", 2, "YAML: but found another document"),
        (b"case: 2020-01-01\n", 1, "the YAML tag timestamp is not allowed"),
        (b"case: x\nspace: !!python/object:os.system {}\n", 2, "python/object:os.system is not allowed"),
        (b"base: &b {x: 1}\ncase:\n  <<: *b\n", 3, "the key '<<' is not text; put it in quotes"),
        (b"case: x\n" + b"1" * 400 + b": 2\n", 2, f"the key '{'1' * 40}...' is not text"),
        (b"case: x\n" + b"a" * 400 + b": 2\n" + b"a" * 400 + b": 2\n", 3, f"'{'a' * 40}...' stands twice"),
        (b"case: x\n1: 2\n", 2, "the key '1' is not text; put it in quotes"),
        (b"case: 0x\nspace: 1" + b"0" * 5000, 2, "can't be read as a number"),
        (b"case: 1e400\n", 1, "1e400 is not a number of size at most 1e+15"),
        (b"case: x\nspace: 1" + b"0" * 399, 2, "is not a number of size at most 1e+15"),
        (b"case: x\nspace: -0x" + b"f" * 400, 2, "is not a number of size at most 1e+15"),
        (b"case: .nan\n", 1, ".nan is not a number of size at most 1e+15"),
        (b"case: -.inf\n", 1, "-.inf is not a number of size at most 1e+15"),
        (b"# old\n%YAML 1.3\n---\ncase: x\n", 2, "YAML: expected version 1.1 or 1.2, not 1.3"),
        (b"%YAML 2.0 # new\n---\ncase: x\n", 1, "YAML: expected version 1.1 or 1.2, not 2.0"),
        (b"%YAML 1." + b"3" * 5000 + b"\n---\ncase: x\n", 1, "YAML: expected version 1.1 or 1.2, not 1.333"),
        (b"case: x\n...\n%YAML 1.3\n---\na: 1\n", 3, "YAML: expected version 1.1 or 1.2"),
        (
            b"%YAML 1.1\n---\ncase: x\nb: on\n",
            4,
            "'on' is a truth value in YAML 1.1 only; write true or false",
        ),
        (b"%YAML 1.1\n---\ncase: No\n", 3, "'No' is a truth value in YAML 1.1 only"),
        (b"case: !!bool on\n", 1, "'on' is no truth value; write true or false"),
        (b"%YAML 1.1\n---\ncase: 010\n", 3, "010 is another number in YAML 1.1 than in 1.2"),
        (b'case: x\nspace: "\\UFFFFFFFF"\n', 2, "YAML: an escape in quotes stands for no character"),
        (b'case: x\nspace: "a\n\n  \\U00110000"\n', 4, "YAML: an escape in quotes stands for no character"),
        (b'case: x\nspace: "\\ud800"\n', 2, "half of a surrogate pair is not text"),
        (b"case:\n" + b"- " * 300 + b"x", 2, "YAML: nested deeper than 100 levels"),
        (
            b"a: &a [x]\n"
            + b"".join(b"b%d: &b%d [*%s]\n" % (n, n, b"b%d" % (n - 1) if n else b"a") for n in range(150)),
            100,
            "YAML: nested deeper than 100 levels",
        ),
        (b"case: x\nspace: &s\n  again: *s\n", 2, "the anchor 's' contains an alias of itself"),
        (billion_laughs(9).encode(), 6, "expand to more than 1000000 values"),
        (b"a: *b\n", 1, "YAML: found undefined alias 'b'"),
        (b"case: " + b"[" * 20_000, 1, "YAML: more than 200 open brackets"),
        (b"case:\n" + b"- " * 2_000, None, "YAML: nested too deeply"),
    ],
)
def test_unreadable_file(tmp_path: Path, content: bytes, line: int | None, message: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_declared_case(path)
    assert caught.value.line == line
    assert message in caught.value.message
    assert str(caught.value).startswith(str(path))


def test_a_missing_file_and_a_folder_without_case(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.yaml: no such file"):
        load_declared_case(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match=r"case\.yaml: no such file"):
        load_declared_case(tmp_path)
    (tmp_path / "case.yaml").mkdir()
    with pytest.raises(InputError, match="is a folder, expected a YAML file"):
        load_declared_case(tmp_path)
    with pytest.raises(InputError, match="can't be read: File name too long"):
        load_declared_case("x" * 5000)


def test_a_file_that_is_too_large_or_no_file(tmp_path: Path) -> None:
    path = write_case(tmp_path, "#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match=f"has {MAX_BYTES + 1} bytes, at most {MAX_BYTES} are allowed"):
        load_declared_case(path)
    with pytest.raises(InputError, match="is not a regular file"):
        load_declared_case("/dev/null")


def test_yaml_1_2_data(tmp_path: Path) -> None:
    """YAML 1.2, core schema (section 10.3): on, no and 1:30 are text, 010 is ten, 0o10 is eight."""
    text = "a: [on, no, 1:30, 010, 0o10, 0x1F, 1.5, 1e3, true, ~, '1', -2]\nb: {x: &x [1], y: *x}\n"
    document = read_document(write_case(tmp_path, text))
    assert document.data == {
        "a": ("on", "no", "1:30", 10, 8, 31, 1.5, 1000.0, True, None, "1", -2),
        "b": {"x": (1,), "y": (1,)},
    }
    assert document.content == text.encode()


def test_an_anchor_may_stand_twice(tmp_path: Path) -> None:
    """YAML 1.2, section 3.2.2.2: an alias is of the most recent one; nothing is printed about it."""
    path = write_case(tmp_path, "a: &x 1\nb: &x 2\nc: *x\n")
    assert read_document(path).data == {"a": 1, "b": 2, "c": 2}


def test_values_of_the_command_line() -> None:
    assert read_value("", "--set", "x") is None
    assert read_value("[64, on]", "--set", "x") == (64, "on")
    with pytest.raises(InputError, match=r"--set: x: 1{40}\.\.\. is not a number of size at most"):
        read_value("1" * 400, "--set", "x")


def test_a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_bytes(b"\xef\xbb\xbfcase: x\n")
    assert read_document(path).data == {"case": "x"}


def test_lines_and_keys_of_errors(tmp_path: Path) -> None:
    document = read_document(write_case(tmp_path, "a:\n  - b: 1\n    c:\n      - 2\n      - 3\n"))
    deep = document.error(("a", 0, "c", 1), "wrong")
    assert (deep.line, deep.key) == (5, "a[0].c[1]")
    absent = document.error(("a", 0, "x", "y"), "wrong")
    assert (absent.line, absent.key) == (2, "a[0]")
    assert document.error((), "wrong").line == 1
