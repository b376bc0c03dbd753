from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from merap.errors import InputError, OutputError
from merap.families.folder import MANIFEST, result_folder, write_file, write_manifest


def write_result(folder: Path, files: dict[str, str], kind: str = "prism") -> None:
    with result_folder(folder, kind) as staging:
        for name, content in files.items():
            (staging / name).write_text(content, encoding="utf-8")
        write_manifest(staging, kind, {"case": "small"}, list(files))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*")}


def test_a_result_is_written_with_a_manifest_of_its_files(tmp_path: Path) -> None:
    write_result(tmp_path / "new" / "out", {"a.prism": "mdp\n", "b.prism": ""})
    out = tmp_path / "new" / "out"
    assert {path.name for path in out.iterdir()} == {"a.prism", "b.prism", MANIFEST}
    manifest = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
    assert manifest == {
        "kind": "prism",
        "case": "small",
        "files": [
            {"file": "a.prism", "sha256": hashlib.sha256(b"mdp\n").hexdigest()},
            {"file": "b.prism", "sha256": hashlib.sha256(b"").hexdigest()},
        ],
    }
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_a_result_of_the_same_kind_is_replaced_whole(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_result(out, {"a.prism": "old", "b.prism": "old"})
    write_result(out, {"a.prism": "new", "c.prism": "new"})
    assert {path.name for path in out.iterdir()} == {"a.prism", "c.prism", MANIFEST}
    assert (out / "a.prism").read_text(encoding="utf-8") == "new"


def test_writing_the_same_twice_leaves_the_same_bytes(tmp_path: Path) -> None:
    write_result(tmp_path / "out", {"a.prism": "mdp\n"})
    before = contents(tmp_path / "out")
    write_result(tmp_path / "out", {"a.prism": "mdp\n"})
    assert contents(tmp_path / "out") == before


def test_an_empty_folder_is_filled_and_stays_the_same_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # somebody stands in it: `merap render case.yaml -o .`
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    write_result(Path(), {"a.prism": "mdp\n"})
    assert sorted(path.name for path in Path().iterdir()) == ["a.prism", MANIFEST]
    assert tmp_path.stat().st_ino == inode


@pytest.mark.parametrize("stranger", ["notes.txt", ".hidden", "models/a.prism"])
def test_a_folder_with_something_else_is_refused_and_left_alone(tmp_path: Path, stranger: str) -> None:
    out = tmp_path / "out"
    write_result(out, {"a.prism": "old"})
    (out / stranger).parent.mkdir(exist_ok=True)
    (out / stranger).write_text("mine", encoding="utf-8")
    before = {path: path.is_file() and path.read_bytes() for path in out.rglob("*")}
    with pytest.raises(OutputError, match=f"holds something else \\({Path(stranger).parts[0]}\\)"):
        write_result(out, {"a.prism": "new"})
    assert {path: path.is_file() and path.read_bytes() for path in out.rglob("*")} == before


def test_a_result_of_another_kind_is_refused(tmp_path: Path) -> None:
    write_result(tmp_path / "out", {"a.umb": "old"}, kind="umb")
    with pytest.raises(OutputError, match="holds something else"):
        write_result(tmp_path / "out", {"a.prism": "new"})
    assert (tmp_path / "out" / "a.umb").read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize("manifest", ["", "[]", "{}", '{"kind": "prism"}', '{"kind": "prism", "files": [1]}'])
def test_a_manifest_that_is_none_vouches_for_nothing(tmp_path: Path, manifest: str) -> None:
    (tmp_path / MANIFEST).write_text(manifest, encoding="utf-8")
    (tmp_path / "a.prism").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="holds something else"):
        write_result(tmp_path, {"a.prism": "new"})
    assert (tmp_path / "a.prism").read_text(encoding="utf-8") == "mine"


def test_a_folder_in_place_of_a_file_of_the_result_is_refused(tmp_path: Path) -> None:
    write_result(tmp_path, {"a.prism": "old"})
    (tmp_path / "a.prism").unlink()
    (tmp_path / "a.prism").mkdir()
    with pytest.raises(OutputError, match=r"holds something else \(a.prism\)"):
        write_result(tmp_path, {"a.prism": "new"})


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="is a file, expected a folder"):
        write_result(tmp_path / "out", {"a.prism": "new"})
    with pytest.raises(OutputError, match="can't be written: Not a directory"):
        write_result(tmp_path / "out" / "deeper", {"a.prism": "new"})
    assert (tmp_path / "out").read_text(encoding="utf-8") == "mine"


def test_a_failure_leaves_the_old_result_in_place(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_result(out, {"a.prism": "old", "b.prism": "old"})
    before = contents(out)

    def fail() -> None:
        with result_folder(out, "prism") as staging:
            (staging / "a.prism").write_text("new", encoding="utf-8")
            raise InputError("too bad")

    with pytest.raises(InputError, match="too bad"):
        fail()
    assert contents(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_failure_leaves_nothing_where_nothing_was(tmp_path: Path) -> None:
    with pytest.raises(InputError), result_folder(tmp_path / "deep" / "out", "prism"):
        raise InputError("too bad")
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_does_not_bar_the_next(tmp_path: Path) -> None:
    write_result(tmp_path, {"a.prism": "old"})
    (tmp_path / ".merap-killed").mkdir()
    write_result(tmp_path, {"a.prism": "new"})
    assert (tmp_path / "a.prism").read_text(encoding="utf-8") == "new"


def test_an_operating_system_error_is_one_line(tmp_path: Path) -> None:
    too_long = "a" * 300
    with (
        pytest.raises(OutputError, match="can't be written: File name too long"),
        result_folder(tmp_path / "out", "prism") as staging,
    ):
        (staging / too_long).write_text("", encoding="utf-8")
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_not_written_over_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "report.json"
    write_file(path, "old")
    with pytest.raises(OutputError, match="exists already"):
        write_file(path, "new")
    assert path.read_text(encoding="utf-8") == "old"
    write_file(path, "new", force=True)
    assert path.read_text(encoding="utf-8") == "new"
    assert [entry.name for entry in path.parent.iterdir()] == ["report.json"]


@pytest.mark.parametrize("force", [False, True])
def test_a_file_that_cannot_be_written_leaves_no_trace(tmp_path: Path, force: bool) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    (tmp_path / "folder").mkdir()
    for name in ("file/report.json", "folder", "a" * 300):
        with pytest.raises(OutputError):
            write_file(tmp_path / name, "new", force=force)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "folder"]
