"""One-step errors on the real counts, what `sidestep counts` reports, and requests that have no answer."""

from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.counts import AUCKLAND_SOURCE, TEST, TRAIN, CountsError, CountTable, read_counts
from sidestep.crowds.summary import LAST_WEEK, PERSISTENCE, PROFILE, one_step_errors, periods, summarise_counts

ARIMA = "ARIMA(1, 0, 0)"

# sensor: mean; RMSE of persistence, last week, ARIMA(1, 0, 0), profile; phi and sigma of the ARIMA (docs, FACTS)
MEASURED = {
    "45 Queen Street": (785, 302, 192, 296, 177, 0.87, 224),
    "210 Queen Street": (614, 222, 149, 218, 87, 0.92, 209),
    "2 High Street": (104, 38, 36, 37, 27, 0.88, 35),
}


@pytest.mark.parametrize("sensor", MEASURED)
def test_errors_of_the_real_sensors(auckland: CountTable, sensor: str) -> None:
    e = one_step_errors(auckland, sensor)
    errors = [e.rmse[name] for name in (PERSISTENCE, LAST_WEEK, ARIMA, PROFILE)]
    found = (e.mean, *errors, float(e.arima_model.ar[0]), e.arima_model.sigma)
    np.testing.assert_allclose(np.array(found), MEASURED[sensor], rtol=0.02)
    assert e.hours == 1989  # 83 days; less the hour that the clock went through twice, its successor and their echoes


def test_differencing_helps_the_arima_a_little(auckland: CountTable) -> None:
    e = one_step_errors(auckland, "45 Queen Street", order=(1, 1, 0))
    assert e.rmse["ARIMA(1, 1, 0)"] == pytest.approx(290, rel=0.02)
    assert float(e.arima_model.sigma) == pytest.approx(226, rel=0.02)


def small_table(weeks: int) -> CountTable:
    rng = np.random.default_rng(0)
    times = np.datetime64("2024-01-01T00", "h") + np.arange(weeks * 168) * np.timedelta64(1, "h")
    counts = rng.poisson(50 + 40 * np.sin(np.arange(len(times)) * 2 * np.pi / 24), size=len(times)).astype(float)
    removed = np.where(np.arange(len(times)) < 8 * 168, counts, np.nan)
    counts = np.stack([counts, np.full(len(times), np.nan), removed], axis=1)
    return CountTable(times, ("bridge", "dead", "removed"), counts, None, (), "mine.csv")


def test_periods_of_auckland_and_of_other_tables(auckland: CountTable) -> None:
    assert auckland.source == AUCKLAND_SOURCE
    assert periods(auckland) == (TRAIN, TEST)
    train, test = periods(small_table(10))
    assert train == ("2024-01-01T00", "2024-02-26T00")
    assert test == ("2024-02-26T00", "2024-03-11T00")


def test_any_table_can_be_tested() -> None:
    table = small_table(10)
    e = one_step_errors(table, "bridge", *periods(table))
    assert e.hours == 2 * 168
    assert e.rmse[PROFILE] < e.rmse[LAST_WEEK]
    assert e.rmse[PROFILE] == pytest.approx(50**0.5, rel=0.15)  # Poisson noise; nothing else is unpredictable


@pytest.mark.parametrize(
    ("sensor", "train", "test", "field"),
    [
        ("ferry", ("2024-01-01", "2024-02-26"), ("2024-02-26", "2024-03-11"), "ferry"),
        ("dead", ("2024-01-01", "2024-02-26"), ("2024-02-26", "2024-03-11"), "dead"),
        ("bridge", ("2023-01-01", "2023-02-26"), ("2024-02-26", "2024-03-11"), None),
        ("bridge", ("2024-01-01", "2024-01-05"), ("2024-02-26", "2024-03-11"), "bridge"),
        ("removed", ("2024-01-01", "2024-02-26"), ("2024-02-27", "2024-03-11"), "removed"),
        ("bridge", ("2024-01-01", "2024-02-26"), ("soon", "2024-03-12"), None),
    ],
)
def test_hopeless_requests(sensor: str, train: tuple[str, str], test: tuple[str, str], field: str | None) -> None:
    with pytest.raises(CountsError) as caught:
        one_step_errors(small_table(10), sensor, train, test)
    assert caught.value.field == field
    assert str(caught.value).startswith("mine.csv: ")


def test_a_file_is_summarised_as_its_table_is_tested(tmp_path: Path) -> None:
    table = small_table(10)
    path = tmp_path / "bridge.csv"
    rows = [f"{t}:00,{c:g}" for t, c in zip(table.times, table.series("bridge"), strict=True)]
    path.write_text("\n".join(["time,bridge", *rows]))
    found = summarise_counts(path, None, (1, 0, 0), 0)
    e = one_step_errors(table, "bridge", *periods(table))
    assert (found.sensor, found.rmse, found.tested_hours) == ("bridge", e.rmse, e.hours)
    assert (found.first, found.last, found.hours) == ("2024-01-01T00", "2024-03-10T23", 1680)
    assert (found.order, found.ar, found.sigma) == ((1, 0, 0), e.arima_model.ar.tolist(), float(e.arima_model.sigma))
    assert found.simulated_mean == pytest.approx(found.counted_mean, rel=0.5)
    assert read_counts(path).repairs == found.repairs == ()


def test_of_short_files_it_is_said_how_to_write_them(tmp_path: Path) -> None:
    file = tmp_path / "short.csv"
    file.write_text("time,Quay\n" + "".join(f"2024-03-04T{hour:02},{hour}\n" for hour in range(12)))
    with pytest.raises(CountsError, match="--out") as caught:
        summarise_counts(file, None, (1, 0, 0), 0)
    assert caught.value.field == "Quay"
    file.write_text("time,Quay\n2024-03-04T00,1\n")
    with pytest.raises(CountsError, match="--out"):
        summarise_counts(file, None, (1, 0, 0), 0)
