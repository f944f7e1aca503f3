"""What the paths of the HTTP API have in common: parameters, bodies and answers."""

import re
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from fastapi import Query, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.responses import Response

from sidestep.routing.request import at_fault
from sidestep.server.osrm_options import Pair, Text, check_coordinates, read_coordinates
from sidestep.server.problems import PLANNER, GeoJsonResponse, ProblemError
from sidestep.server.town import ServedTown

M = TypeVar("M", bound=BaseModel)
Place = Annotated[str, Query(max_length=80, description="Longitude and latitude, with a comma between them.")]
Time = Annotated[
    str | None, Query(max_length=40, description="Local time: ISO 8601, Fri 17:30 or, of today, 17:30; by default now.")
]
PlannerName = Annotated[
    str | None, Query(pattern=PLANNER, description="Who plans; by default expected, or darp where there is a model.")
]
Walker = Annotated[str | None, Query(max_length=200, description="Who walks, as in sidestep route --walker.")]
Objective = Annotated[
    str | None, Query(max_length=200, description="What is kept low, as in sidestep route --objective.")
]
Futures = Annotated[int | None, Query(ge=1, le=1000, description="Simulated futures.")]


class Question(BaseModel):
    """What all bodies have that ask for walks; longitudes come before latitudes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    origin: Pair
    depart_at: Text | None = None
    """Local time; by default now."""
    planner: Annotated[str, Field(pattern=PLANNER)] | None = None
    walker: Text | None = None
    objective: Text | None = None
    avoid: dict[str, Any] | None = None
    """GeoJSON polygons whose streets are not walked."""


def town_of(request: Request) -> ServedTown:
    """The town that is served."""
    served: ServedTown = request.app.state.town
    return served


def only_known(request: Request) -> None:
    """Refuse parameters that a path does not have, and those that are given twice; for the router of the paths.

    Parameters
    ----------
    request
        The request.

    Raises
    ------
    ProblemError
        With the parameter as its field.
    """
    known = {each.alias for each in request.scope["route"].dependant.query_params}
    given = [name for name, _ in request.query_params.multi_items()]
    for name in given:
        if name not in known:
            raise ProblemError(400, f"{name!r:.60} is no parameter here", field=name[:60])
        if given.count(name) > 1:
            raise ProblemError(400, f"{name} is given twice", field=name)


def room_to_listen(request: Request) -> None:
    """Refuse more listeners than there is room for (503)."""
    if request.app.state.bus.full:
        raise ProblemError(503, "too many listen already; ask again later", headers={"retry-after": "30"})


def query_of(request: Request, model: type[M]) -> M:
    """The parameters in the query of a request; FastAPI's own way to many of them takes as long as a short answer.

    Parameters
    ----------
    request, model
        The request, and what its query may have.

    Returns
    -------
    M
        The parameters.

    Raises
    ------
    ProblemError
        Parameters that are given twice.
    RequestValidationError
        Anything else that the model does not allow.
    """
    query = request.query_params
    given = {name: values if len(values := query.getlist(name)) > 1 else values[0] for name in query}
    try:
        return _valid(model.model_validate, given)
    except RequestValidationError as error:  # several are fine where there may be a list of them
        faults = {each["loc"][0] for each in error.errors()}
        if (twice := next((name for name in faults if isinstance(given.get(name), list)), None)) is not None:
            raise ProblemError(400, f"{twice} is given twice", field=twice, code="InvalidQuery") from error
        raise


async def body_of(request: Request, model: type[M]) -> M:
    """The body of a request, strictly as JSON.

    Parameters
    ----------
    request, model
        The request, and what its body must be like.

    Returns
    -------
    M
        The body.

    Raises
    ------
    ProblemError
        Bodies of another type (415).
    RequestValidationError
        Anything that the model does not allow.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in {"application/json", ""}:
        raise ProblemError(415, f"the body must be application/json, not {kind!r:.60}", field="content-type")
    return _valid(model.model_validate_json, await request.body())


def _valid(validate: Callable[[Any], M], given: Any) -> M:
    try:
        return validate(given)
    except ValidationError as error:
        raise RequestValidationError(error.errors(include_url=False)) from error


def asks(model: type[BaseModel]) -> dict[str, Any]:
    """What the OpenAPI document says of a query that is read here."""
    fields = model.model_json_schema()["properties"]
    return {"parameters": [{"name": name, "in": "query", "schema": schema} for name, schema in fields.items()]}


def takes(model: type[BaseModel]) -> dict[str, Any]:
    """What the OpenAPI document says of a body that is read here."""
    schema = model.model_json_schema()
    schema = _inlined(schema, schema.pop("$defs", {}))
    return {"requestBody": {"required": True, "content": {"application/json": {"schema": schema}}}}


def _inlined(schema: Any, definitions: dict[str, Any]) -> Any:
    """A JSON schema without references: in the OpenAPI document these would lead elsewhere."""
    if isinstance(schema, list):
        return [_inlined(each, definitions) for each in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    return {name: _inlined(each, definitions) for name, each in schema.items()}


def place_of(field: str, text: str) -> tuple[float, float]:
    """Latitude and longitude of a parameter, which has the longitude first."""
    try:
        ((longitude, latitude),) = read_coordinates(text, 1)
    except (ProblemError, ValueError) as error:
        said = f"{field} must be LONGITUDE,LATITUDE in degrees, such as 24.94,60.17, not {text!r:.60}"
        raise ProblemError(400, said, field=field) from error
    return latitude, longitude


def located(field: str, place: Pair) -> tuple[float, float]:
    """Latitude and longitude of a place in a body, which has the longitude first; ProblemError where it is none."""
    with at_fault(field):
        ((longitude, latitude),) = check_coordinates([place])
    return latitude, longitude


def numbers_of(field: str, text: str, most: int) -> list[float]:
    """Numbers with commas between them."""
    try:
        if not re.fullmatch(r"[-+.,\deE]*", text, re.ASCII):
            raise ValueError  # noqa: TRY301 - as for numbers that are none
        found = [float(each) for each in text.split(",")]
    except ValueError as error:
        raise ProblemError(
            400, f"{field} must be numbers with commas between them, not {text!r:.60}", field=field
        ) from error
    if len(found) > most:
        raise ProblemError(400, f"{field} may be {most} numbers at most, not {len(found)}", field=field)
    return found


def geojson(content: dict[str, Any]) -> Response:
    """An answer in GeoJSON."""
    return GeoJsonResponse(content)
