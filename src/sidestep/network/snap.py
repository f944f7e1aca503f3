"""The street nearest to a place."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from sidestep.network.town import Town, TownError

FARTHEST = 250.0  # m from the nearest street; what is further is taken to be outside the town


@dataclass(frozen=True)
class Snapped:
    """A place on a street."""

    street: int
    part: float  # of the street's length, from its tail
    away: float  # m from the place that was asked for
    place: tuple[float, float]  # latitude and longitude, degrees


@dataclass(frozen=True, eq=False)
class Snapper:
    """Finds the nearest street of a town; made once, it answers in well under a millisecond."""

    town: Town

    def nearest(self, latitude: float, longitude: float, farthest: float = FARTHEST) -> Snapped:
        """The nearest place on a street.

        Raises
        ------
        TownError
            Coordinates that are none, or further than ``farthest`` metres from every street.
        """
        if not (-90 <= latitude <= 90 and -180 <= longitude <= 180):
            raise TownError(
                f"{latitude:g}, {longitude:g} is no place: give degrees of latitude (-90 to 90), then of longitude"
            )
        here = self.town.project(np.array([longitude, latitude]))
        start, end, leg = self._legs
        # No leg can be nearer than its middle less half the longest leg.
        nearest_middle, _ = self._tree.query(here)
        near = np.array(self._tree.query_ball_point(here, nearest_middle + self._longest))
        along = end[near] - start[near]
        share = np.clip(
            np.einsum("ij,ij->i", here - start[near], along) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0
        )
        away = np.linalg.norm(start[near] + share[:, None] * along - here, axis=1)
        best = int(away.argmin())
        if away[best] > farthest:
            raise TownError(
                f"{latitude:g}, {longitude:g} is {away[best]:,.0f} m from the nearest street, "
                f"so it is not in this town ({self._extent()})"
            )
        point, part = int(leg[near[best]]), float(share[best])
        a, b = self.town.points[point], self.town.points[point + 1]
        longitude, latitude = (a + part * (b - a)).tolist()
        street = int(np.searchsorted(self.town.first, point, side="right")) - 1
        return Snapped(street, self._part(street, point, part), float(away[best]), (latitude, longitude))

    @cached_property
    def _legs(
        self,
    ) -> tuple[Float[np.ndarray, "leg 2"], Float[np.ndarray, "leg 2"], Int[np.ndarray, " leg"]]:
        """Straight pieces of all courses: where they begin and end, and the point that each begins with."""
        place = self.town.project(self.town.points)
        leg = np.setdiff1d(np.arange(len(place) - 1), self.town.first[1:] - 1)
        return place[leg], place[leg + 1], leg

    @cached_property
    def _tree(self) -> KDTree:
        start, end, _ = self._legs
        return KDTree((start + end) / 2)

    @cached_property
    def _longest(self) -> float:
        start, end, _ = self._legs
        return float(np.linalg.norm(end - start, axis=1).max()) / 2 * (1 + 1e-9)

    def _part(self, street: int, point: int, share: float) -> float:
        """How much of a street's course lies before a place on the leg that begins with a point."""
        begin, stop = self.town.first[street], self.town.first[street + 1]
        legs = np.linalg.norm(np.diff(self.town.project(self.town.points[begin:stop]), axis=0), axis=1)
        before = legs[: point - begin].sum() + share * legs[point - begin]
        return float(before / max(legs.sum(), 1e-12))

    def _extent(self) -> str:
        (west, south), (east, north) = self.town.place.min(axis=0), self.town.place.max(axis=0)
        return f"latitude {south:.4f} to {north:.4f}, longitude {west:.4f} to {east:.4f}"
