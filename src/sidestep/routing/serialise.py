"""The shape of ``route --json`` for real places."""

from typing import TypedDict

import numpy as np
from jaxtyping import Float

from sidestep.evaluation.metrics import spread
from sidestep.routing.directions import crowding_word, directions, mean_density
from sidestep.routing.plan import Journey, Others
from sidestep.routing.request import End


class EndJson(TypedDict):
    """Origin or destination of a walk."""

    asked: str
    latitude: float  # on the street
    longitude: float
    metres_away: float


class StepJson(TypedDict):
    """One line of the directions."""

    turn: str
    street: str
    metres: float
    minutes: float
    density: float
    crowding: str


class LegJson(TypedDict):
    """One street from crossing to crossing."""

    street: int
    name: str
    kind: str
    metres: float
    minutes: float
    density: float
    coordinates: list[list[float]]  # longitude and latitude


class OtherJson(TypedDict):
    """Another planner in the same futures, or in the first of them."""

    level: str
    futures: int
    median_minutes: float
    p90_minutes: float
    mean_difference_minutes: float  # above zero where it takes longer
    mean_difference_exposure: float | None  # above zero where it meets more people; None where time is all that counts
    arrival_rate: float


class JourneyJson(TypedDict):
    """A planned walk through a real place in ``route --json``."""

    scenario: str
    objective: dict[str, float | None] | None  # weights of what is kept low; None: time
    planner: str
    level: str
    departure: str | None
    departs: str
    hour_of_week: float | None  # None: crowds know no time, and the walk begins with their first slot
    counted_sensors: int | None  # with current counts; None where none were given
    sensors: int | None  # None where crowds come from a table
    origin: EndJson
    destination: EndJson
    steps: list[StepJson]
    legs: list[LegJson]
    nodes: list[int]
    metres: float
    expected_minutes: float
    arrives: bool
    mean_density: float
    exposure: float  # crowd met, person·s/m²
    too_dense: int  # streets entered above the maximum density
    crowding: str
    futures: int
    median_minutes: float
    p90_minutes: float
    arrival_rate: float
    by_minutes: float | None
    arrive_by: float | None
    others: dict[str, OtherJson]
    attribution: str
    crowds: str


def itinerary(journey: Journey, by: float | None = None) -> JourneyJson:
    """Everything that is known of a planned walk; ``by`` are minutes to arrive within."""
    trip, found = journey.trip, spread(journey.minutes, journey.arrived, by)
    density = mean_density(journey.legs)
    return {
        "scenario": trip.scenario.name,
        "objective": trip.scenario.objective.to_json(),
        "planner": journey.planner.name,
        "level": journey.planner.level,
        "departure": None if trip.departure.time is None else trip.departure.time.isoformat(),
        "departs": trip.departure.text,
        "hour_of_week": trip.departure.hour,
        "counted_sensors": trip.counted,
        "sensors": len(set(trip.place.sensors)) or None,
        "origin": _end_json(trip.origin),
        "destination": _end_json(trip.destination),
        "steps": [
            {
                "turn": step.turn,
                "street": step.street,
                "metres": step.metres,
                "minutes": step.minutes,
                "density": step.density,
                "crowding": crowding_word(step.density),
            }
            for step in directions(journey.legs)
        ],
        "legs": [
            {
                "street": leg.street,
                "name": leg.name,
                "kind": leg.kind,
                "metres": leg.metres,
                "minutes": leg.minutes,
                "density": leg.density,
                "coordinates": np.round(leg.course, 7).tolist(),
            }
            for leg in journey.legs
        ],
        "nodes": list(journey.route.nodes),
        "metres": sum(leg.metres for leg in journey.legs),
        "expected_minutes": journey.route.seconds / 60,
        "arrives": journey.route.arrived,
        "mean_density": density,
        "exposure": sum(leg.exposure for leg in journey.legs),
        "too_dense": sum(leg.too_dense for leg in journey.legs),
        "crowding": crowding_word(density),
        "futures": len(journey.minutes),
        "median_minutes": found["median_minutes"],
        "p90_minutes": found["p90_minutes"],
        "arrival_rate": float(journey.arrived.mean()),
        "by_minutes": by,
        "arrive_by": found["arrive_by"],
        "others": {name: _other_json(journey, other) for name, other in journey.others.items()},
        "attribution": trip.streets.town.attribution,
        "crowds": trip.crowds,
    }


def _end_json(end: End) -> EndJson:
    latitude, longitude = end.place
    return {"asked": end.text, "latitude": latitude, "longitude": longitude, "metres_away": end.away}


def _difference(other: Float[np.ndarray, " some"], ours: Float[np.ndarray, " future"]) -> float:
    """In the mean of those futures that both walked."""
    return float(np.mean(other - ours[: len(other)]))


def _other_json(journey: Journey, other: Others) -> OtherJson:
    found = spread(other.minutes, other.arrived, None)
    return {
        "level": other.planner.level,
        "futures": len(other.minutes),
        "median_minutes": found["median_minutes"],
        "p90_minutes": found["p90_minutes"],
        "mean_difference_minutes": _difference(other.minutes, journey.minutes),
        "mean_difference_exposure": None
        if other.exposure is None or journey.exposure is None
        else _difference(other.exposure, journey.exposure),
        "arrival_rate": float(other.arrived.mean()),
    }
