"""Maps of a scenario, drawn from a seed: streets, and the crowds expected on them."""

import hashlib
from dataclasses import replace
from datetime import datetime
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sidestep.crowds.base import FlowModel
from sidestep.crowds.counts import CountTable
from sidestep.crowds.live import latest_counts
from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import SplitStreets
from sidestep.scenarios.build import venue_parts
from sidestep.scenarios.grids import DrawnGrid, streets_and_crowds
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Grid, Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.walking.waits import NoWaits, Waits

Purpose = Literal["learn", "explore", "test"]
PURPOSES: tuple[Purpose, ...] = get_args(Purpose)


class ScenarioMap(eqx.Module):
    """Streets, the crowds on them with the model that moves them, and what walkers wait for.

    Several maps side by side, with no street between them, are one: ``parts`` has the number of nodes of each.
    """

    network: RoadNetwork
    flow: FlowModel
    test_flow: FlowModel
    """What walks are tested on: recorded crowds where there are any, else ``flow``."""
    key: Key[Array, ""]
    """Random stream of this map; futures and training fold their purpose into it."""
    parts: tuple[int, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True, default=())
    """The sensor behind each counter of the flow, where crowds are known from sensors."""
    origins: tuple[int, ...] = eqx.field(static=True, default=())
    """Nodes where walks begin; none: anywhere."""
    destinations: tuple[int, ...] = eqx.field(static=True, default=())
    """Nodes where walks end; none: anywhere."""
    waits: Waits | NoWaits = NoWaits()
    """At lights and for gaps in the traffic."""

    def flow_for(self, purpose: Purpose) -> FlowModel:
        """The crowds that walks of one purpose meet."""
        return self.test_flow if purpose == "test" else self.flow

    def on_pieces(self, streets: SplitStreets) -> "ScenarioMap":
        """The same map with some streets split and crowds as dense on all their pieces, for walks from anywhere.

        Futures for tests are simulated: there are only as many recorded weeks as were counted, and none goes on from
        now.
        """
        parent, fraction = jnp.asarray(streets.parent), jnp.asarray(streets.fraction, jnp.float32)
        flow = self.flow.on_pieces(parent, fraction)
        return replace(
            self,
            network=streets.network,
            flow=flow,
            test_flow=flow,
            parts=(streets.network.nodes,),
            origins=(),
            destinations=(),
            waits=self.waits.on_pieces(parent, jnp.asarray(streets.begins_at_crossing)),
        )

    @property
    def fingerprint(self) -> str:
        """The same for the same streets with the same expected crowds, whatever the speed law, and for no others."""
        told = (self.network, self.flow, self.waits)
        digest = hashlib.sha256(str(jax.tree.structure(told)).encode())
        for leaf in jax.tree.leaves(told):
            digest.update(f"{leaf.shape}".encode() + np.asarray(leaf).tobytes())
        return digest.hexdigest()[:16]


def draw_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """Map number ``index`` of a seed; the same for every planner and for every kind of flow.

    Venues have the same streets and expected crowds on all maps; only the futures differ.

    Parameters
    ----------
    scenario
        The problem.
    seed, index
        Of 0 or more. Grids of several sides take them in turn by ``index``.

    Raises
    ------
    SidestepError
        Negative numbers, files of a venue that cannot be read or do not fit.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.maps import draw_map
    >>> drawn = draw_map(scenario("paper-congested", side=3, crowded_nodes=2), seed=0)
    >>> drawn.network.nodes, drawn.network.segments
    (9, 24)
    """
    key = _key(seed, index)
    match scenario.place:
        case Grid() as grid:
            side = grid.sides[index % len(grid.sides)]
            return _on_grids(grid, [DrawnGrid.draw(grid, side, np.random.default_rng([seed, index]))], scenario, key)
        case Venue() as venue:
            parts = venue_parts(venue, scenario.slot_seconds, scenario.law)
            return ScenarioMap(key=key, parts=(parts.network.nodes,), **parts._asdict())


def draw_training_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """What an agent learns on that will walk map number ``index``: that map, or others, as the scenario says.

    The others are drawn from another stream than all maps that agents are compared on.

    Parameters
    ----------
    scenario, seed, index
        As for :func:`draw_map`.

    Raises
    ------
    SidestepError
        As :func:`draw_map`.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> from sidestep.scenarios.maps import draw_training_map
    >>> draw_training_map(scenario("unseen-maps", side=3, crowded_nodes=1, training_maps=2), seed=0).parts
    (9, 9)
    """
    match scenario.place:
        case Grid(training_maps=number) as grid if number:
            rngs = [np.random.default_rng([seed, another, _LEARN]) for another in range(number)]
            drawn = [DrawnGrid.draw(grid, grid.side, rng) for rng in rngs]
            return _on_grids(grid, drawn, scenario, _key(seed, index))
        case _:
            return draw_map(scenario, seed, index)


_LEARN = 1  # a third number makes another stream: no map that is compared on has one


def _key(seed: int, index: int) -> Key[Array, ""]:
    if min(seed, index) < 0:
        raise ScenarioError(f"seed and number of a map must not be negative, not {seed} and {index}")
    # A key made of plain numbers needs no compiled program.
    return jax.random.wrap_key_data(jnp.asarray(np.random.SeedSequence([seed, index]).generate_state(2)))


def _on_grids(grid: Grid, drawn: list[DrawnGrid], scenario: Scenario, key: Key[Array, ""]) -> ScenarioMap:
    network, flow = streets_and_crowds(grid, drawn, scenario.slot_seconds)
    return ScenarioMap(network, flow, flow, key, tuple(one.network.nodes for one in drawn))


def purpose_key(scenario_map: ScenarioMap, purpose: Purpose) -> Key[Array, ""]:
    """The random stream of one purpose on one map."""
    return jax.random.fold_in(scenario_map.key, PURPOSES.index(purpose))


def with_live_counts(scenario_map: ScenarioMap, table: CountTable, departure: datetime) -> tuple[ScenarioMap, int]:
    """A map whose crowds go on from current counts.

    Parameters
    ----------
    scenario_map
        The map.
    table
        Counts as the sensors count them; the crowding of the place is multiplied onto them. Its last hour matters, and
        sensors without a count in it are not known.
    departure
        Local wall time of clock 0.

    Returns
    -------
    scenario_map, known
        The map, and the number of sensors with a count.

    Raises
    ------
    CountsError
        Crowds that are not known from sensors; sensors that the place does not have, counts of another hour than that
        of the departure or the one before it, no count at all.
    """
    names = list(dict.fromkeys(scenario_map.sensors))
    latest = latest_counts(table, names, departure)
    counts = latest.counts[[names.index(name) for name in scenario_map.sensors]]
    flow = scenario_map.flow.going_on_from(replace(latest, counts=counts))
    return replace(scenario_map, flow=flow, test_flow=flow), latest.known
