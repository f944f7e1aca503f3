"""What is kept of files, and until when."""

import os
import threading
from pathlib import Path

import pytest

from sidestep.errors import SidestepError
from sidestep.files import OutputError, cached_by_files, check_above, check_apart, only_one, output_folder, write_text


@pytest.mark.parametrize("name", ["read", "./made/../read", "link", "hard", "folder/inside"])
def test_files_that_are_read_are_not_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("made", "folder"):
        Path(folder).mkdir()
        Path(folder, "inside").touch()
    Path("read").touch()
    Path("link").symlink_to("read")
    Path("hard").hardlink_to("read")
    read = (None, "none", "a\0b", "read", Path("folder"))
    with pytest.raises(OutputError) as caught:
        check_apart(Path(name), read)
    assert caught.value.field == "out"
    for other in ("made/inside", "none", "folder/none", "none/read"):
        check_apart(Path(other), read)


def test_only_the_last_folder_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("made", tmp_path / "made" / "within", ".", "made/../made", "made"):
        check_above(Path(folder))
        assert output_folder(Path(folder)).is_dir()
    Path("file").touch()
    for folder in ("a/b", "a/b/c", tmp_path / "made" / "a" / "b", "file", "file/b", "file/b/c"):
        with pytest.raises(OutputError) as caught:
            output_folder(Path(folder), "walks_out")
        assert caught.value.field == "walks_out"
    for folder in ("a/b", "file/b/c"):
        with pytest.raises(OutputError) as caught:
            check_above(Path(folder))
        assert caught.value.field == "out"
    assert sorted(each.name for each in tmp_path.rglob("*")) == ["file", "made", "within"]


def test_results_are_kept_while_files_stay_as_they_are(tmp_path: Path) -> None:
    read = []

    @cached_by_files(lambda name, _: (name,))
    def words(name: str, times: int) -> str:
        """As they stand there."""
        read.append((name, times))
        return Path(name).read_text() * times

    file = tmp_path / "words"
    file.write_text("one")
    os.utime(file, ns=(5, 5))
    assert words(str(file), 2) == words(str(file), 2) == "oneone"
    assert words(str(file), 1) == "one"
    assert read == [(str(file), 2), (str(file), 1)]
    file.write_text("two")  # as long
    os.utime(file, ns=(6, 6))
    assert words(str(file), 1) == "two"
    file.write_text("three")
    os.utime(file, ns=(6, 6))
    assert words(str(file), 1) == "three"
    assert words.__doc__ == "As they stand there."


def test_what_is_no_file_never_changes() -> None:
    made = []
    keep = cached_by_files(lambda name: (name,))(lambda name: made.append(name) or len(made))
    assert [keep(name) for name in ("helsinki", "a\0b", "helsinki", "a\0b")] == [1, 2, 1, 2]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real/a.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real" / "a.txt").read_text() == "new"
    assert [file.name for file in (tmp_path / "real").iterdir()] == ["a.txt"]


def test_pipes_and_devices_are_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe"):
        write_text(tmp_path / "pipe", "text")
    assert (tmp_path / "pipe").is_fifo()


def test_who_may_wait_holds_a_file_as_soon_as_nobody_else_does(tmp_path: Path) -> None:
    path, refusal, order = tmp_path / "lock", SidestepError("busy"), []

    def wait() -> None:
        with only_one(path):
            order.append("waited")

    waiting = threading.Thread(target=wait)
    with only_one(path):
        waiting.start()
        with pytest.raises(SidestepError) as caught, only_one(path, refusal):  # half a second later
            pass
        assert caught.value is refusal
        order.append("let go")
    waiting.join(10)
    assert order == ["let go", "waited"]
