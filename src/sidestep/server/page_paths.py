"""The map page, and the files that it loads: all of them are in the package."""

from functools import lru_cache
from pathlib import Path

from fastapi import APIRouter, Request
from starlette.responses import Response

from sidestep.server.documents import Document
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


@lru_cache(maxsize=64)
def _read(path: Path, _changed: int) -> Document:
    return Document(path.read_bytes(), KINDS[path.suffix])


def _found(name: str) -> Document | None:
    """A file of the page; None where there is none of that name."""
    names = {path.relative_to(WEB).as_posix(): path for folder in (WEB, WEB / "vendor") for path in folder.glob("*.*")}
    path = names.get(name)
    if path is None or path.suffix not in KINDS:
        return None
    return _read(path, path.stat().st_mtime_ns)


@router.api_route("/", methods=["GET", "HEAD"])
async def page(request: Request) -> Response:
    """The map page; in a checkout without MapLibre GL which command fetches that."""
    index = _found("index.html")
    if index is None or _found(NEEDED) is None:
        return Response(MISSING, status_code=503, media_type="text/plain; charset=utf-8")
    return index.answer(request)


@router.api_route("/assets/{name:path}", methods=["GET", "HEAD"])
async def asset(request: Request, name: str) -> Response:
    """A file of the page."""
    file = _found(name)
    if file is None or name == "index.html":
        raise ProblemError(404, "there is nothing at this address")
    return file.answer(request)
