"""Errors as HTTP answers: problem details (RFC 9457), or, for the services of OSRM, its codes."""

import json
import re
from reprlib import repr as quoted
from typing import Any

from fastapi.exceptions import RequestValidationError
from pydantic_core import to_json
from starlette.requests import Request
from starlette.responses import Response

from sidestep.crowds.live import LiveError
from sidestep.errors import SidestepError
from sidestep.server.store import StoreError

SERVICES = frozenset({"route", "table", "nearest"})
"""Those of OSRM that there are here."""
_OSRM = re.compile(r"/([\w.~:-]+)/v(\d+)/[\w.~:-]+(/.*)?", re.ASCII | re.DOTALL)
"""Paths of OSRM: service, version, profile, and what is asked."""
_TITLES = {
    400: "Bad request",
    401: "No valid API key",
    403: "Forbidden",
    404: "Not found",
    405: "Method not allowed",
    408: "Too slow",
    409: "Conflict",
    411: "Length required",
    413: "Too large",
    414: "Address too long",
    415: "Unsupported media type",
    422: "Invalid content",
    429: "Too many requests",
    431: "Headers too large",
    500: "Internal error",
    503: "Unavailable",
}
_CODES = {400: "InvalidValue", 404: "InvalidUrl", 405: "InvalidUrl", 413: "TooBig", 500: "InternalError"}
_RANGES = ("greater_than", "less_than", "too_long", "too_short")
"""Beginnings of pydantic's words for values that can be read, but are not allowed."""

PLANNER = r"^[\w.-]{1,80}$"
"""Names of planners only: elsewhere ``module:name`` is one, too, which imports a module and calls what is in it."""
WALK_ID = "^[0-9a-f]{32}$"
PATTERNS = {
    PLANNER: "the name of a planner, such as expected",
    WALK_ID: "the id of a walk, 32 of the digits 0 to 9 and a to f",
}
"""What texts must be that must have a form."""
_TYPES = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "finite": "a finite number",
    "string": "a text",
    "list": "a list",
    "tuple": "a list",
    "dict": "an object",
    "model": "an object",
    "datetime": "a date and a time, such as 2025-05-23T16:00",
}
"""What values must be, by the beginnings of pydantic's words for them."""
_TAKES = {
    "greater_than": "more than {gt:.10g}",
    "greater_than_equal": "{ge:.10g} or more",
    "less_than": "less than {lt:.10g}",
    "less_than_equal": "{le:.10g} or less",
    "too_long": "a list of at most {max_length}",
    "too_short": "a list of at least {min_length}",
    "string_too_long": "a text of at most {max_length} characters",
    "string_too_short": "a text of at least {min_length} characters",
    "literal_error": "{expected}",
}
"""The same by whole words, with pydantic's limits."""


class ProblemError(SidestepError):
    """A request that is refused.

    Parameters
    ----------
    status
        HTTP status.
    detail
        One sentence.
    field
        The parameter at fault, if one is.
    code
        OSRM's word for it; by default one for the status.
    headers
        Of the answer.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        field: str | None = None,
        code: str | None = None,
        headers: dict[str, str] | None = None,
    ) -> None:
        super().__init__(detail, field=field)
        self.status, self.code, self.headers = status, code, headers or {}


class JsonResponse(Response):
    """JSON, written by pydantic, which is several times as fast as the standard library."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        return to_json(content, inf_nan_mode="null")


class GeoJsonResponse(JsonResponse):
    """GeoJSON (RFC 7946)."""

    media_type = "application/geo+json"


def is_osrm(path: str) -> bool:
    """Whether errors at a path have OSRM's shape."""
    return bool(_OSRM.fullmatch(path)) or path[1:].split("/", maxsplit=1)[0] in SERVICES


def refused(path: str, problem: ProblemError) -> Response:
    """Answer a request with what is wrong with it.

    Parameters
    ----------
    path
        Path of the request, which decides the shape.
    problem
        What is wrong.

    Returns
    -------
    Response
        Without any trace of the code.
    """
    status, said = problem.status, str(problem)
    asked = _OSRM.fullmatch(path)
    if is_osrm(path):
        code = problem.code or _CODES.get(status, "InvalidQuery")
        if status == 404 and asked and asked[1] not in SERVICES:
            code, said = "InvalidService", f"there is no service {asked[1]:.40} here, but {', '.join(sorted(SERVICES))}"
        elif status == 404 and asked and asked[2] != "1":
            code, said = "InvalidVersion", "the version of the services is v1"
        content: dict[str, Any] = {"code": code, "message": said}
        # Every client of OSRM knows 400; what servers refuse for other reasons has the usual status.
        status = 400 if status in {404, 422} else status
        return JsonResponse(content, status, problem.headers)
    content = {"type": "about:blank", "title": _TITLES.get(status, "Error"), "status": status, "detail": said}
    content["field"] = problem.field
    return JsonResponse(content, status, problem.headers, media_type="application/problem+json")


def of_error(error: SidestepError) -> ProblemError:
    """What is wrong with a request that the packages below refuse."""
    if isinstance(error, ProblemError):
        return error
    if isinstance(error, LiveError):
        return ProblemError(415 if error.field == "content_type" else 422, str(error), field=error.field)
    if isinstance(error, StoreError):
        said = "the server cannot store anything at the moment; send it again later"
        return ProblemError(503, said, field="store", headers={"retry-after": "5"})
    return ProblemError(400, str(error), field=error.field)


def of_validation(errors: list[Any]) -> ProblemError:
    """What is wrong with parameters, from the first mistake that pydantic found.

    Parameters
    ----------
    errors
        As pydantic or FastAPI list them.

    Returns
    -------
    ProblemError
        With the parameter as its field.
    """
    parameter = _name(errors[0]["loc"]).partition(".")[0]
    of_it = [(_name(each["loc"]), each) for each in errors]
    of_it = [(name, each) for name, each in of_it if name.partition(".")[0] == parameter]
    # Of the types that it may have the one is meant that fits best; where several do, all are told.
    name, first = max(of_it, key=lambda found: found[0].count("."))
    kind = str(first["type"])
    if kind == "extra_forbidden":
        return ProblemError(400, f"{name} is no parameter here", field=name, code="InvalidQuery")
    if kind == "json_invalid":
        return ProblemError(400, "the body is not JSON", field="body", code="InvalidQuery")
    code = "InvalidOptions" if kind.startswith(_RANGES) else "InvalidQuery"
    if kind.startswith("too_") and "." in name:  # no list of values, but a pair that is none
        code = "InvalidQuery"
    elif kind == "too_long" and name == "coordinates":
        code = "TooBig"
    said = _sentence(name or "the body", [each for other, each in of_it if other == name])
    return ProblemError(422, said, field=name or None, code=code)


def _name(place: tuple[Any, ...]) -> str:
    """The parameter, with numbers of its parts and their members, and without pydantic's names of types."""
    parts = [each for each in place if each not in {"query", "body", "path"}]
    kept = [
        str(each)[:80]
        for number, each in enumerate(parts)
        if number == 0 or isinstance(each, int) or isinstance(parts[number - 1], int)
    ]
    return ".".join(kept)


def _sentence(name: str, errors: list[Any]) -> str:
    """What a parameter must be, and what it is: for each of pydantic's words one of ours."""
    first = errors[0]
    kind, context = str(first["type"]), first.get("ctx", {})
    if kind == "missing":
        return f"{name} is missing"
    if kind == "value_error":
        return f"{name}: {context['error']}"
    given = first["input"]
    got = json.dumps(given) if isinstance(given, bool | None) else quoted(given)
    if kind.endswith(("too_long", "too_short")):
        got = f"of {context.get('actual_length') or len(given)}"
    takes = ", or ".join(dict.fromkeys(map(_takes, errors)))
    return f"{name} must be {takes}, not {got}"


def _takes(error: Any) -> str:
    """What a value must be."""
    kind, limits = str(error["type"]), error.get("ctx", {})
    if kind == "string_pattern_mismatch":
        return PATTERNS[limits["pattern"]]
    said = _TAKES.get(kind) or _TYPES.get(kind.partition("_")[0], "of another kind")
    return said.format(**limits).replace(" False", " false")


async def on_error(request: Request, error: Exception) -> Response:
    """Answer what the packages below refuse."""
    assert isinstance(error, SidestepError)  # noqa: S101 - registered for these
    return refused(request.url.path, of_error(error))


async def on_validation(request: Request, error: Exception) -> Response:
    """Answer what FastAPI refuses."""
    assert isinstance(error, RequestValidationError)  # noqa: S101 - registered for these
    return refused(request.url.path, of_validation(list(error.errors())))
