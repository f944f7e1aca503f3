"""How crowded the streets are expected to be at some time."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.base import FlowModel
from sidestep.network.graph import RoadNetwork
from sidestep.routing.directions import CROWDING, crowding_word, street_label
from sidestep.routing.facts import SceneFacts, StreetMap, collection, without_map
from sidestep.routing.formats import feature, table
from sidestep.routing.located import Located
from sidestep.routing.request import on_map

LISTED = 20
"""Streets in the text."""


@dataclass(frozen=True, kw_only=True)
class StreetCrowd:
    """The crowd on one street, or in one direction of it."""

    street: int | None
    """Number of the street in its town; None on grids."""

    name: str | None
    """Name, empty where it has none; None on grids."""

    kind: str | None
    """The value of OpenStreetMap's key ``highway``; None on grids."""

    nodes: tuple[int, int]
    """Crossings at its ends."""

    metres: float
    """Length."""

    density: float
    """Expected persons/m²; of both directions of a street the larger."""

    crowding: str
    """A word for the density."""


@dataclass(frozen=True, kw_only=True)
class StreetCrowds(SceneFacts):
    """How crowded the streets are expected to be.

    Examples
    --------
    >>> import sidestep
    >>> crowds = sidestep.Router(sidestep.scenario("paper-congested", side=3, crowded_nodes=1)).crowds(at=10)
    >>> len(crowds.streets), crowds.departs
    (24, '10 min after the start')
    """

    streets: Sequence[StreetCrowd]
    """All streets of a town, or all segments of a grid."""

    map: StreetMap | None = field(compare=False, repr=False)
    """For pictures and GeoJSON; None on grids."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the map, ready for ``json.dumps``."""
        return without_map(self, "map")

    def to_geojson(self) -> dict[str, Any]:
        """A GeoJSON feature collection (RFC 7946): a line for each street.

        Returns
        -------
        dict
            Ready for ``json.dumps``; coordinates are longitudes and latitudes in degrees.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        said = {"scenario": self.scenario, "at": self.departs}
        town = on_map(self.map).town
        lines = [
            feature("LineString", np.round(town.course(number), 7).tolist(), part="street", **vars(street), **said)
            for number, street in enumerate(self.streets)
        ]
        return collection(self, lines)

    def to_text(self) -> str:
        """The share of the streets that is crowded, and the densest ones, for people."""
        total = sum(street.metres for street in self.streets)
        shares = []
        for _, word in CROWDING:
            metres = sum(street.metres for street in self.streets if street.crowding == word)
            shares.append((word, f"{metres / 1000:,.1f}", f"{100 * metres / total:.1f} %"))
        densest = sorted(self.streets, key=lambda street: -street.density)[:LISTED]
        rows = [
            (
                street_label(street.name, street.kind),
                "{} to {}".format(*street.nodes),
                f"{street.metres:,.0f}",
                street.crowding,
                f"{street.density:.2f}",
            )
            for street in densest
        ]
        lines = [
            f"Crowds expected on the streets of {self.scenario}, {self.departs}:",
            "",
            *table(("crowds", ">km", ">of the streets"), shares),
            "",
            *table(("densest streets", "crossings", ">metres", "crowds", ">persons/m²"), rows),
            "",
            *self.notes(),
        ]
        return "\n".join(lines) + "\n"


@partial(jax.jit, static_argnames="slots")
def _densities(
    flow: FlowModel, network: RoadNetwork, hours: Float[Array, " hour"], slots: int
) -> Float[Array, "slot segment"]:
    return flow.expected(hours, slots).density(network)[0]


def street_crowds(located: Located) -> StreetCrowds:
    """Look up how crowded the streets are expected to be.

    Parameters
    ----------
    located
        The streets, and when.

    Returns
    -------
    StreetCrowds
        The density on every street.
    """
    scenario, here = located.scenario, located.scenario_map
    hours = jnp.asarray(located.hours, jnp.float32)
    slot = min(int(located.clock // scenario.slot_seconds), scenario.slots - 1)
    density = np.asarray(_densities(here.flow, here.network, hours, scenario.slots))[slot]
    return StreetCrowds(
        **vars(located.facts),
        streets=tuple(
            StreetCrowd(**named, density=persons, crowding=crowding_word(persons))
            for named, persons in located.named_streets(density)
        ),
        map=located.street_map(density),
    )
