"""Crowds on a whole network: how many people are on each segment in each slot."""

from dataclasses import replace
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.arima import Arima, forecast, simulate
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.network.graph import RoadNetwork

SLOT_SECONDS = 300.0


class FlowField(eqx.Module):
    """Volumes per slot and segment; leading axes, if any, count alternative crowds."""

    volume: Float[Array, "*future slot segment"]  # persons, positive
    slot_seconds: float = eqx.field(static=True, default=SLOT_SECONDS)

    @property
    def counted(self) -> Float[Array, "*future slot segment"]:
        """What is known of a slot when everything is counted."""
        return self.volume

    def flow_matrix(self, network: RoadNetwork, slot: int) -> Float[Array, "node node"]:
        """The paper's P of one slot (eq. 2): persons from node i to node j, -1 where there is no segment."""
        return network.matrix(self.volume[slot])

    def density(self, network: RoadNetwork) -> Float[Array, "*future slot segment"]:
        """Persons per m²."""
        return self.volume / (network.length * network.width)

    def with_counted(self, counted: Float[Array, "*future slot segment"]) -> "FlowField":
        """The same with other volumes."""
        return replace(self, volume=counted)


class SensedField(eqx.Module):
    """Densities at sensors per slot; leading axes, if any, count alternative crowds."""

    sensed: Float[Array, "*future slot sensor"]  # persons/m²
    weights: InterpolationWeights
    slot_seconds: float = eqx.field(static=True)

    @property
    def counted(self) -> Float[Array, "*future slot sensor"]:
        """What is known of a slot when everything is counted."""
        return self.sensed

    def density(self, _network: RoadNetwork) -> Float[Array, "*future slot segment"]:
        """Persons per m² on every segment."""
        return self.weights.everywhere(self.sensed)

    def with_counted(self, counted: Float[Array, "*future slot sensor"]) -> "SensedField":
        """The same with other densities at the sensors."""
        return replace(self, sensed=counted)


Field = FlowField | SensedField


@runtime_checkable
class FlowModel(Protocol):
    """A source of crowds for one network."""

    def expected(self, slots: int) -> Field:
        """The forecast made at clock 0: what somebody who knows the usual crowds expects."""
        ...

    def draw(self, key: Key[Array, ""], futures: int, slots: int) -> Field:
        """Possible futures, with a leading axis of ``futures``."""
        ...

    def ahead(
        self, now: Float[Array, " counter"], slot: Int[Array, ""], slots: int, future: Int[Array, ""] | int = 0, /
    ) -> Float[Array, "slots counter"]:
        """The forecast of slot number ``slot`` and those after it, made when its counts ``now`` are known."""
        ...


class ArimaFlow(eqx.Module):
    """The paper's crowds: every segment starts at its own volume and follows one fitted ARIMA model (section V-A).

    The power law gives zero time to a segment without people, so volumes are held at ``floor`` or more.
    """

    initial: Float[Array, " segment"]  # persons at clock 0
    model: Arima  # its step is the slot
    floor: float = eqx.field(static=True, default=1.0)

    def expected(self, slots: int) -> FlowField:
        return self._field(forecast(self.model, self.initial[None], slots - 1))

    def draw(self, key: Key[Array, ""], futures: int, slots: int) -> FlowField:
        innovations = jax.random.normal(key, (slots - 1, futures, self.initial.shape[0]))
        history = jnp.broadcast_to(self.initial, (1, futures, self.initial.shape[0]))
        return self._field(simulate(self.model, history, innovations))

    def ahead(
        self, now: Float[Array, " segment"], _slot: Int[Array, ""], slots: int, _crowd: Int[Array, ""] | int = 0
    ) -> Float[Array, "slots segment"]:
        """The model's forecast; the counts of now are all that an AR(1) needs to know."""
        volume = jnp.concatenate([now[None], forecast(self.model, now[None], slots - 1)])
        return jnp.maximum(volume, self.floor)

    def _field(self, later: Float[Array, "later *future segment"]) -> FlowField:
        now = jnp.broadcast_to(self.initial, later.shape[1:])[None]
        volume = jnp.moveaxis(jnp.concatenate([now, later]), 0, -2)
        return FlowField(jnp.maximum(volume, self.floor), self.model.step)
