"""The map page, and the files that it loads: all of them are in the package."""

import gzip
import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header
from starlette.responses import Response

from sidestep.server.problems import ProblemError

router = APIRouter(include_in_schema=False)
WEB = Path(__file__).parents[1] / "web"
KINDS = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
"""Media types of the files that are served; others are not."""
NEEDED = "vendor/maplibre-gl.mjs"
MISSING = (
    "The map page needs MapLibre GL, whose files are not in this checkout.\n"
    "Run: make page\n"
    "Wheels have them. Everything but the page works without them.\n"
)


@dataclass(frozen=True)
class _File:
    content: bytes
    zipped: bytes
    tag: str
    kind: str


@lru_cache(maxsize=64)
def _read(path: Path, _changed: int) -> _File:
    content = path.read_bytes()
    tag = f'"{hashlib.sha256(content).hexdigest()[:16]}"'
    return _File(content, gzip.compress(content, mtime=0), tag, KINDS[path.suffix])


def _found(name: str) -> _File | None:
    """A file of the page; None where there is none of that name."""
    names = {path.relative_to(WEB).as_posix(): path for folder in (WEB, WEB / "vendor") for path in folder.glob("*.*")}
    path = names.get(name)
    if path is None or path.suffix not in KINDS:
        return None
    return _read(path, path.stat().st_mtime_ns)


def _sent(file: _File, accepted: str | None, known: str | None) -> Response:
    # Browsers ask each time whether a file is still the same, so a newer server never meets an older page.
    headers = {"etag": file.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
    if known is not None and file.tag in known:
        return Response(status_code=304, headers=headers)
    if "gzip" in (accepted or ""):
        return Response(file.zipped, headers={**headers, "content-encoding": "gzip"}, media_type=file.kind)
    return Response(file.content, headers=headers, media_type=file.kind)


Accepted = Annotated[str | None, Header()]
Known = Annotated[str | None, Header()]


@router.api_route("/", methods=["GET", "HEAD"])
async def page(accept_encoding: Accepted = None, if_none_match: Known = None) -> Response:
    """The map page; in a checkout without MapLibre GL which command fetches that."""
    index = _found("index.html")
    if index is None or _found(NEEDED) is None:
        return Response(MISSING, status_code=503, media_type="text/plain; charset=utf-8")
    return _sent(index, accept_encoding, if_none_match)


@router.api_route("/assets/{name:path}", methods=["GET", "HEAD"])
async def asset(name: str, accept_encoding: Accepted = None, if_none_match: Known = None) -> Response:
    """A file of the page."""
    file = _found(name)
    if file is None or name == "index.html":
        raise ProblemError(404, "there is nothing at this address")
    return _sent(file, accept_encoding, if_none_match)
