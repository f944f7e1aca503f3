"""What is kept of files, and until when."""

import os
from pathlib import Path

from sidestep.files import cached_by_files


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
