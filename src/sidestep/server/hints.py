"""Hints of OSRM: places on streets as text that clients send back."""

import base64
import struct
import zlib
from collections.abc import Sequence

from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.server.osrm_options import Pair

_HINT = struct.Struct("<IIdii")
DIGITS = 6
"""Of degrees, as OSRM has them: clients look for waypoints among the points of a line, which must be the same."""


class Hinter:
    """Writes places on streets as text that clients send back, so that these are not looked for again.

    Parameters
    ----------
    snapper
        Of the streets; hints of other streets are ignored.
    """

    def __init__(self, snapper: Snapper) -> None:
        self._snapper = snapper
        self._sum = zlib.crc32(snapper.town.points.tobytes())

    def hint(self, point: StreetPoint, coordinate: Pair) -> str:
        """Text for a place on a street, found for a longitude and a latitude."""
        return base64.urlsafe_b64encode(
            _HINT.pack(self._sum, point.street, point.fraction, *_fixed(coordinate))
        ).decode()

    def point(self, hint: str | None, longitude: float, latitude: float) -> StreetPoint | None:
        """The place on a street that a hint says.

        Parameters
        ----------
        hint
            Text of :meth:`hint`; anything else is ignored.
        longitude, latitude
            Degrees of the place that is asked for.

        Returns
        -------
        StreetPoint or None
            None where it must be looked for, as for other coordinates than those of the hint.
        """
        try:
            total, street, fraction, *coordinate = _HINT.unpack(base64.urlsafe_b64decode(hint or ""))
        except (ValueError, struct.error):
            return None
        if total != self._sum or not (0 <= street < self._snapper.town.streets and 0 <= fraction <= 1):
            return None
        if tuple(coordinate) != _fixed((longitude, latitude)):
            return None
        return self._snapper.at(street, fraction, latitude, longitude)


def _fixed(coordinate: Pair) -> tuple[int, int]:
    longitude, latitude = coordinate
    return round(longitude * 10**DIGITS), round(latitude * 10**DIGITS)


def rounded(place: Sequence[float]) -> Pair:
    """A longitude and latitude with as many digits as all places have in answers."""
    longitude, latitude = place
    return round(longitude, DIGITS), round(latitude, DIGITS)
