"""Train agents for the pages of the documentation, once each."""

import json
from pathlib import Path
from typing import Any

from sidestep.agent.config import TrainConfig
from sidestep.agent.runs import train
from sidestep.files import write_text
from sidestep.scenarios.model import Scenario


def trained(folder: Path, scenario: Scenario, config: TrainConfig, seed: int) -> dict[str, Any]:
    """Train an agent on map 0 into a folder, unless it is there already; returns what ``train --json`` prints."""
    told = folder / "trained.json"
    if not told.exists():
        write_text(told, json.dumps(train(scenario, config, seed=seed, out=folder, overwrite=True).to_json()))
    return json.loads(told.read_text(encoding="utf-8"))
