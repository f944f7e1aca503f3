"""What processes of a sweep do, and what they leave."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def children(process: int) -> list[int]:
    """The workers of a sweep."""
    try:
        found = [
            int(each) for file in Path(f"/proc/{process}/task").glob("*/children") for each in file.read_text().split()
        ]
        return [each for each in found if b"resource_tracker" not in Path(f"/proc/{each}/cmdline").read_bytes()]
    except OSError:
        return []


def until(ready: Callable[[], Any], seconds: float = 60.0) -> Any:
    """Wait for something."""
    end = time.monotonic() + seconds
    while not (found := ready()):
        assert time.monotonic() < end
        time.sleep(0.01)
    return found


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def walks_of(out: Path) -> dict[str, Any]:
    """The walks of each job that is done."""
    return {file.parent.name: json.loads(file.read_text())["records"] for file in out.glob("*/result.json")}
