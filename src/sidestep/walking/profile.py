"""What one kind of walker makes of streets and crowds: its law of speed, its pace on stairs, and streets it takes."""

import numpy as np
from jaxtyping import Bool, Float32

from sidestep.network.town import Town
from sidestep.walking.speed_laws import FREE_SPEED, Sensitive, SpeedLaw

STAIRS_UP, STAIRS_DOWN = 0.61, 0.69
"""Horizontal speed on stairs in m/s where that on level ground is ``FREE_SPEED`` (Weidmann 1993)."""
STEPS, LIFT = "steps", "elevator"
"""Kinds of streets, as OpenStreetMap has them."""


def own_law(law: SpeedLaw, free_speed: float, crowd_factor: float) -> SpeedLaw:
    """A speed law as it is for one walker.

    Parameters
    ----------
    law
        That of people of any free speed.
    free_speed
        The walker's, in m/s.
    crowd_factor
        How many times as dense crowds are to the walker, who slows down accordingly.

    Returns
    -------
    SpeedLaw
        The law itself for an average adult.
    """
    own = law.scaled(free_speed)
    return own if crowd_factor == 1 else Sensitive(own, crowd_factor, free_speed=free_speed)


def stair_speeds(free_speed: float, up: float | None, down: float | None) -> tuple[float, float]:
    """Horizontal speeds in m/s up and down stairs; those that are None are in proportion to an adult's."""
    slower = free_speed / FREE_SPEED
    return STAIRS_UP * slower if up is None else up, STAIRS_DOWN * slower if down is None else down


def paces(
    town: Town, free_speed: float, up: float | None = None, down: float | None = None
) -> Float32[np.ndarray, " segment"] | None:
    """Speed on each segment over that on level ground: stairs are slower.

    Parameters
    ----------
    town
        The streets. Where a stair's incline is unknown, its pace both ways is the mean of those up and down.
    free_speed
        On level ground, in m/s.
    up, down
        Horizontal speeds in m/s on stairs; by default in proportion to an adult's.

    Returns
    -------
    Float32[np.ndarray, " segment"] | None
        For the segments of ``town.network()``; None where there are no stairs.
    """
    stairs = np.array(town.kind) == STEPS
    if not stairs.any():
        return None
    street, backwards = town.street_of_segment()
    rise = np.where(backwards, -1.0, 1.0) * town.incline[street]
    upwards, downwards = stair_speeds(free_speed, up, down)
    speed = np.where(rise > 0, upwards, np.where(rise < 0, downwards, (upwards + downwards) / 2))
    return np.where(stairs[street], speed / free_speed, 1.0).astype(np.float32)


def lift_waits(town: Town, seconds: float) -> Float32[np.ndarray, " segment"] | None:
    """Seconds that lifts take beside the way to them, before each segment; None where nobody waits for one."""
    lifts = np.array(town.kind) == LIFT
    if not lifts.any() or not seconds:
        return None
    return np.where(lifts[town.street_of_segment()[0]], seconds, 0.0).astype(np.float32)


def passable(
    town: Town,
    *,
    stairs: bool,
    lifts: bool,
    least_width: float,
    highest_kerb: float | None,
    steepest: float | None,
) -> Bool[np.ndarray, " street"]:
    """Which streets a walker can take.

    Parameters
    ----------
    town
        The streets. Kerbs and inclines that nobody mapped stop nobody.
    stairs, lifts
        Whether these are taken.
    least_width
        Metres that the walker needs.
    highest_kerb
        Metres of the highest kerb that is taken; None: any.
    steepest
        Largest rise or fall for each metre of other streets than stairs; None: any.

    Returns
    -------
    Bool[np.ndarray, " street"]
        True where the walker can go, in all directions in which the street is walked.
    """
    kind, tolerance = np.array(town.kind), 1e-6  # towns keep single precision
    taken = town.width >= least_width - tolerance
    if not stairs:
        taken &= kind != STEPS
    if not lifts:
        taken &= kind != LIFT
    if highest_kerb is not None:
        taken &= town.kerb <= highest_kerb + tolerance
    if steepest is not None:
        taken &= ~(np.abs(town.incline) > steepest + tolerance) | (kind == STEPS)
    return taken
