"""Answers that stay the same for long: zipped once, with tags by which browsers ask whether they still are."""

import gzip
import hashlib
from dataclasses import dataclass
from functools import cached_property

from fastapi import Request
from starlette.responses import Response


@dataclass(frozen=True)
class Document:
    """A document."""

    content: bytes
    kind: str
    """Its media type."""

    @cached_property
    def zipped(self) -> bytes:
        """The content, compressed by gzip."""
        return gzip.compress(self.content, mtime=0)

    @cached_property
    def tag(self) -> str:
        """Its entity tag."""
        return f'"{hashlib.sha256(self.content).hexdigest()[:16]}"'

    def answer(self, request: Request) -> Response:
        """Send it, unless the browser has it. Browsers ask each time: the next server here may have another."""
        headers = {"etag": self.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
        if self.tag in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(self.zipped, headers={**headers, "content-encoding": "gzip"}, media_type=self.kind)
        return Response(self.content, headers=headers, media_type=self.kind)
