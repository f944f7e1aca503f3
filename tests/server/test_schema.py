"""What the OpenAPI document says is true: requests made from it, right and wrong ones, and what is answered."""

import zlib
from collections import Counter
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
import requests
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis import GenerationMode
from schemathesis.specs.openapi import checks

from sidestep.server.app import make_app
from sidestep.server.settings import Settings

from .conftest import ENDS

# Hypothesis takes what the app's threads draw for what its strategies draw.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module inside strategies")
NEEDS_A_WALK = {"GET /walks/{walk_id}"}
EXAMPLES, MANY = 10, 150
CENTRE = "0.0001,0.0001"
SENSIBLE: dict[str, list[str]] = {
    "profile": ["foot", "walking"],
    "coordinates": [ENDS, CENTRE, f"{ENDS};0.0013,0.0001"],
    "origin": [CENTRE, "0.0013,0.0026"],
    "destination": ["0.0026,0.0026"],
    "planner": ["expected", "shortest-path", "snapshot"],
    "walker": ["adult", "older"],
    "objective": ["time", "exposure"],
    "depart_at": ["17:30", "Fri 17:30", "2026-11-27T08:00"],
    "arrive_by": ["2026-11-27T18:00"],
    "until": ["2026-11-27T09:00"],
    "at": ["Fri 17:30"],
    "minutes": ["5,10", "3"],
    "q": ["street", "1"],
    "futures": ["1", "20"],
    "step": ["30"],
}
"""What the document cannot know: what there is in a town."""
OTHERS = (
    "hints", "radiuses", "bearings", "approaches", "waypoints", "sources", "destinations", "exclude", "avoid",
    "annotations", "confidence", "alternatives", "fallback_speed", "time", "ahead",
)  # fmt: skip
"""Parameters that fit few others."""
PLACES = {
    "coordinates": [[0.0001, 0.0001], [0.0026, 0.0026]],
    "origin": [0.0001, 0.0001],
    "destination": [0.0026, 0.0026],
    "now": "2026-11-27T08:00:00",
    "minutes": [5, 10],
    "step": 30,
}
"""Members of bodies."""
NOT_IN_THE_DOCUMENT = [checks.positive_data_acceptance]
"""Places outside the town and times that are not known are refused, and the document has no words for that."""

# Of an app without a town, which needs none to say what it takes. Events never end.
schema = schemathesis.openapi.from_dict(make_app(Settings()).openapi()).exclude(path_regex="events$")
schema.config.checks.negative_data_rejection.expected_statuses = ["4xx", "5xx"]


def chosen(number: int, values: list[str]) -> str:
    return values[number % len(values)]


def make_sensible(case: Any) -> None:
    """Let most requests that are right for the document be about places in the town, or little would be answered."""
    number = zlib.crc32(repr((case.query, case.path_parameters, case.body)).encode())
    modes = {case.meta.generation.mode, *(each.mode for each in case.meta.components.values())}
    if modes != {GenerationMode.POSITIVE} or number % 5 == 0:
        return
    # Of wrong bodies that are listed, and not drawn, it does not say that they are wrong.
    listed = case.meta.phase.name.value == "coverage"
    body = case.body if isinstance(case.body, dict) and not listed else {}
    for part in (case.query or {}, case.path_parameters or {}, body):
        for name in [each for each in part if each in OTHERS]:
            del part[name]
        for name in [each for each in part if each in SENSIBLE]:
            part[name] = chosen(number, SENSIBLE[name])
    for name in [each for each in body if each in PLACES]:
        body[name] = PLACES[name]
    if "futures" in body:
        body["futures"] = 20
    if "nearest" in case.operation.path and "coordinates" in body:
        body["coordinates"] = PLACES["coordinates"][:1]


def check(case: Any, client: httpx.Client, answered: Counter[tuple[str, int]]) -> None:
    """Send what was made up, and hold the answer to the document."""
    make_sensible(case)
    asked = requests.Request(**case.as_transport_kwargs(base_url="http://127.0.0.1")).prepare()
    answer = client.request(asked.method, asked.url, headers=dict(asked.headers), content=asked.body)
    answered[case.operation.label, answer.status_code] += 1
    excluded = list(NOT_IN_THE_DOCUMENT)
    if case.operation.path.endswith("/v1/{profile}"):  # of addresses without coordinates OSRM has never heard
        excluded.append(checks.unsupported_method)
    case.validate_response(answer, excluded_checks=excluded)


@pytest.fixture(scope="module")
def answered() -> Iterator[Counter[tuple[str, int]]]:
    """How often each path gave each status: without good answers the tests would be of errors alone."""
    found: Counter[tuple[str, int]] = Counter()
    yield found
    good = {label for label, status in found if status < 300}
    assert {label for label, _ in found if label.startswith("GET")} - NEEDS_A_WALK <= good


@schema.parametrize()
@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
def test_what_the_document_says(case: Any, served, answered) -> None:
    check(case, served, answered)


@pytest.mark.stress
@schema.parametrize()
@settings(max_examples=MANY, deadline=None, suppress_health_check=list(HealthCheck), derandomize=False)
def test_what_the_document_says_for_long(case: Any, served, answered) -> None:
    check(case, served, answered)
