"""Streets by name: what people type, with or without accents, in any case, and only in part."""

import unicodedata
from dataclasses import dataclass

import numpy as np

from sidestep.network.snapping import middle_of
from sidestep.network.town import Town


@dataclass(frozen=True)
class NamedStreet:
    """All streets of one name."""

    name: str
    place: tuple[float, float]
    """Longitude and latitude in the middle of the longest of them, degrees."""
    streets: tuple[int, ...]
    """Their numbers in the town."""
    metres: float
    """Length of all of them."""


class StreetNames:
    """Find streets of a town by name.

    Parameters
    ----------
    town
        The streets.
    """

    def __init__(self, town: Town) -> None:
        by_name: dict[str, list[int]] = {}
        for street, name in enumerate(town.name):
            if name:
                by_name.setdefault(name, []).append(street)
        self._named = [(_folded(name), _named(town, name, streets)) for name, streets in sorted(by_name.items())]

    def search(self, text: str, most: int) -> list[NamedStreet]:
        """Find streets whose names contain a text: first those that begin with it, and of these the longest.

        Parameters
        ----------
        text
            A part of the name.
        most
            How many to find.

        Returns
        -------
        list of NamedStreet
            The best first; none for an empty text.
        """
        wanted = _folded(text)
        if not wanted:
            return []
        found = [
            (not folded.startswith(wanted), -each.metres, each) for folded, each in self._named if wanted in folded
        ]
        return [each for *_, each in sorted(found, key=lambda row: row[:2])[:most]]


def _folded(text: str) -> str:
    """Text without accents and case."""
    apart = unicodedata.normalize("NFKD", text.casefold())
    return " ".join("".join(sign for sign in apart if not unicodedata.combining(sign)).split())


def _named(town: Town, name: str, streets: list[int]) -> NamedStreet:
    length = town.length[streets]
    middle = middle_of(town, streets[int(np.argmax(length))])
    return NamedStreet(name, middle, tuple(streets), float(length.sum()))
