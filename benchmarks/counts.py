"""Measure time and memory to read a table of hourly counts, one row a sensor and hour.

python benchmarks/counts.py                  1,000,000 rows of 20 sensors, invented
python benchmarks/counts.py --rows 100000    fewer
python benchmarks/counts.py --quoted         every cell in quotes
"""

import argparse
import csv
import resource
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
import pandas as pd

from sidestep.crowds.counts import read_counts

SENSORS = 20


def write(path: Path, rows: int, *, quoted: bool) -> None:
    hours = -(-rows // SENSORS)
    clock = pd.date_range("2019-01-01", periods=hours, freq="h")
    daily = 100 * (1.5 + np.sin(2 * np.pi * np.arange(hours) / 24))
    table = pd.DataFrame({
        "Date_Time": np.repeat(clock.strftime("%Y-%m-%d %H:%M:%S"), SENSORS),
        "Sensor_ID": np.tile(np.arange(SENSORS), hours),
        "Sensor_Name": np.tile([f"Street {number}" for number in range(SENSORS)], hours),
        "Hourly_Counts": np.random.default_rng(0).poisson(np.repeat(daily, SENSORS)),
    })  # fmt: skip
    table.to_csv(path, index=False, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--quoted", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "counts.csv"
        write(path, asked.rows, quoted=asked.quoted)
        began, used = perf_counter(), process_time()
        counts = read_counts(path)
        took, worked = perf_counter() - began, process_time() - used
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(
            f"{counts.counts.size:,} counts of {len(counts.sensors)} sensors: read in {took:.1f} s, of which the",
            end=" ",
        )
        print(f"processors worked {worked:.1f} s, at most {peak:.2f} GiB")


if __name__ == "__main__":
    main()
