"""Requests: what people write, and what nobody can ask for."""

import json
import subprocess
import sys
from datetime import date, datetime, timedelta

import numpy as np
import pytest

from sidestep.routing.request import RouteError, RouteRequest, read_departure, read_place


def test_places() -> None:
    assert read_place("origin", "60.17, 24.94") == (60.17, 24.94)
    assert read_place("origin", " -33,+151.2 ") == (-33, 151.2)
    assert read_place("origin", ".5,1.") == (0.5, 1)
    assert read_place("origin", "12") == 12
    assert read_place("origin", "-1") == -1
    for given in (None, 7, (60.17, 24.94)):
        assert read_place("origin", given) == given
    assert read_place("origin", [60, 24.94]) == read_place("origin", np.array([60, 24.94])) == (60.0, 24.94)
    assert type(read_place("origin", np.int64(7))) is int


@pytest.mark.parametrize("text", ["here", "60.17", "60.17;24.94", "1.2.3,4", "", "nan,2", "1,2,3", "٣,٤", ".,."])
def test_other_text_is_no_place(text: str) -> None:
    with pytest.raises(RouteError) as caught:
        read_place("destination", text)
    assert caught.value.field == "destination"


@pytest.mark.parametrize(
    "given", [7.5, True, b"7", {}, (60.17,), (60.17, "24.94"), (1, 2, 3), [True, False], np.array(3.0)]
)
def test_other_things_are_no_place(given: object) -> None:
    with pytest.raises(RouteError) as caught:
        read_place("origin", given)
    assert caught.value.field == "origin"


@pytest.mark.parametrize("given", [True, b"17:30", [], date(2025, 5, 24), timedelta(minutes=5)])
def test_other_things_are_no_departure(given: object) -> None:
    with pytest.raises(RouteError) as caught:
        read_departure(given, "until")
    assert caught.value.field == "until"


WRONG = """
import json, sidestep
grid = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
router, found = sidestep.Router(grid), []
asked = (
    [(sidestep.RouteRequest, (), {name: {1}}) for name in sidestep.RouteRequest.__dataclass_fields__]
    + [(router.plan, (0, 1), {name: {1}}) for name in ("planner", "by", "futures", "live", "avoid", "alternatives")]
    + [(router.plan, (0, 1), {name: {1}}) for name in ("arrive_by", "confidence")]
    + [(router.when, (0, 1), {name: [5]}) for name in ("depart", "until", "step", "planner", "futures", "live")]
    + [(router.isochrone, (0,), {name: {1}}) for name in ("minutes", "depart", "planner", "futures", "live", "avoid")]
    + [(router.isochrone, (0,), {"minutes": given}) for given in (5, "5", ["5"], [None], None)]
    + [(router.matrix, (), {"origins": given}) for given in (5, None, [{}], (60.17, 24.94))]
    + [(router.matrix, ([0],), {name: {1}}) for name in ("destinations", "planner", "futures", "avoid")]
    + [(router.crowds, (), {name: {1}}) for name in ("at", "live")]
    + [(sidestep.Router, (grid,), {name: 1.5}) for name in ("model", "seed", "index")]
    + [(sidestep.plan_route, (grid,), {"request": "0 to 8"})]
    + [(router.plan, (0, 1), {"avoid": given}) for given in (5, [])]
)
for ask, ends, given in asked:
    try:
        ask(*ends, **given)
    except sidestep.SidestepError as error:
        if error.field not in given:
            found.append([ask.__name__, str(given), error.field])
    except Exception as error:
        found.append([ask.__name__, str(given), repr(error)])
    else:
        found.append([ask.__name__, str(given), "taken"])
print(json.dumps(found))
"""


def test_arguments_of_wrong_types() -> None:
    """In a process of its own, where nobody checks types before the code does."""
    done = subprocess.run([sys.executable, "-c", WRONG], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []


def test_departures() -> None:
    assert read_departure("2.5") == 2.5
    assert (
        read_departure(" 2025-05-24T12:30 ")
        == read_departure("2025-05-24 12:30")
        == datetime.fromisoformat("2025-05-24T12:30")
    )
    assert read_departure("2025-05-24T12:30Z").tzinfo is not None
    for given in (None, 30, datetime.fromisoformat("2025-05-24T00:00")):
        assert read_departure(given) == given


@pytest.mark.parametrize("text", ["soon", "2025-05-24", "2025-13-01T12:00", "", "2025-05-24T25:00"])
def test_other_text_is_no_departure(text: str) -> None:
    with pytest.raises(RouteError) as caught:
        read_departure(text)
    assert caught.value.field == "depart"


@pytest.mark.parametrize(
    ("field", "value"),
    [("by", 0), ("by", -5.0), ("by", float("nan")), ("by", float("inf")), ("futures", 0), ("futures", -3)],
)
def test_what_nobody_can_ask_for(field: str, value: float) -> None:
    with pytest.raises(RouteError) as caught:
        RouteRequest(**{field: value})
    assert caught.value.field == field
