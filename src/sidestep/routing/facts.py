"""What is known of a request before anything is planned."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from sidestep.network.town import Town
from sidestep.routing.formats import feature
from sidestep.scenarios.walkers import walker_in_words


@dataclass(frozen=True)
class End:
    """Where a route begins or ends."""

    node: int | None
    """Number of the node; None where it lies in the middle of a street."""

    asked: str
    """What was asked for, for people."""

    latitude: float | None = None
    """Degrees, on the street; None on grids."""

    longitude: float | None = None
    """Degrees, on the street; None on grids."""

    metres_away: float = 0.0
    """Between the place that was asked for and the one on the street."""

    label: str = ""
    """Name of the place, where a file of places has one."""

    @property
    def called(self) -> str:
        """The name of the place, or what was asked for."""
        return self.label or self.asked


@dataclass(frozen=True, eq=False)
class StreetMap:
    """The streets around a route, for pictures."""

    town: Town

    density: Float[np.ndarray, " street"]
    """Persons/m² that are expected on every street at the departure; of both directions the larger."""


@dataclass(frozen=True, kw_only=True)
class SceneFacts:
    """Which streets and crowds an answer is about, and when."""

    scenario: str
    """Name of the scenario."""

    objective: dict[str, float | None] | None
    """Weights of the objective; None: time alone."""

    walker: dict[str, Any] | None = None
    """The walker's numbers, and how many streets are left out; None for the adult that walks unless told otherwise."""

    departure: str | None = None
    """Local time, ISO 8601; None where no day was given."""

    departure_minutes: float = 0.0
    """Minutes after the scenario's start; a scenario in a town starts with the departure."""

    departs: str
    """The departure for people."""

    hour_of_week: float | None = None
    """Of the departure, 0 is Monday 0:00; None where crowds do not depend on it."""

    sensors: int | None = None
    """Number of sensors; None where crowds are not known from sensors."""

    counted_sensors: int | None = None
    """Number of sensors with current counts; None where no counts were given."""

    avoided_streets: int | None = None
    """Number of streets that are not walked since they cross the area to avoid; None where there is none."""

    avoided_area: list[list[list[list[float]]]] | None = None
    """Of each polygon to avoid its outer ring and its holes, as lists of longitude and latitude; None without any."""

    attribution: str
    """Source and licence of the streets."""

    crowds: str
    """Source of the crowds."""

    expected_crowds: str
    """The crowds that are expected, after "Crowds are …"."""

    synthetic: str
    """What is invented, and by how much; empty where nothing is."""

    @property
    def sources(self) -> list[str]:
        """Where streets and crowds come from, and what is synthetic."""
        said = {"Streets": self.attribution, "Crowds": self.crowds, "Synthetic": self.synthetic}
        return [f"{what}: {words}" for what, words in said.items() if words]

    def notes(self) -> list[str]:
        """Sentences below an answer: what is avoided, which crowds are expected, and all sources."""
        streets = self.avoided_streets
        avoided = f"{streets or 'No'} street{'s' * (streets != 1)} cross{'es' * (streets == 1)} the area to avoid."
        return [
            *([] if self.walker is None else [f"Walker: {walker_in_words(self.walker)}."]),
            *([] if streets is None else [avoided]),
            f"Crowds are {self.expected_crowds}.",
            f"{'. '.join(self.sources)}.",
        ]


@dataclass(frozen=True, kw_only=True)
class RequestFacts(SceneFacts):
    """What is known of a request for a route before it is planned."""

    origin: End
    destination: End

    by_minutes: float | None
    """The minutes that were asked about."""

    deadline: str | None = None
    """For people, when to be there; None where nobody asked."""

    confidence: float | None = None
    """The least share of the futures in which the walk arrives by then."""


def without_map(answer: SceneFacts, picture: str) -> dict[str, Any]:
    """All that an answer says but its map, ready for ``json.dumps``.

    Parameters
    ----------
    answer
        A dataclass.
    picture
        Name of the field that pictures need.

    Returns
    -------
    dict
        The other fields.
    """
    empty: dict[str, Any] = {picture: None}  # a town would be copied, too
    found = asdict(replace(answer, **empty))
    del found[picture]
    return found


def collection(facts: SceneFacts, features: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """A GeoJSON feature collection (RFC 7946) that says where its data come from, with the area to avoid at last.

    Parameters
    ----------
    facts
        Which streets and crowds it is about.
    features
        GeoJSON features.

    Returns
    -------
    dict
        Ready for ``json.dumps``; coordinates are longitudes and latitudes in degrees.
    """
    sources = {name: getattr(facts, name) for name in ("attribution", "crowds", "synthetic")}
    area = facts.avoided_area
    avoided = [] if area is None else [feature("MultiPolygon", area, part="avoid", streets=facts.avoided_streets)]
    return {"type": "FeatureCollection", **sources, "features": [*features, *avoided]}
