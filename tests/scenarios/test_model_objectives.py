"""Objectives as people say them."""

import pytest

from sidestep.scenarios.model import ObjectiveSpec, read_objective
from sidestep.scenarios.spec import ScenarioError


@pytest.mark.parametrize(
    ("text", "objective"),
    [
        ("time", ObjectiveSpec()),
        (" exposure ", ObjectiveSpec(time=0.01, exposure=1.0)),
        ("distance", ObjectiveSpec(time=0.0, distance=1.0)),
        ("time=1", ObjectiveSpec()),
        ("exposure=0.5, max_density=4", ObjectiveSpec(exposure=0.5, max_density=4.0)),
        ("time=0,distance=2", ObjectiveSpec(time=0.0, distance=2.0)),
    ],
)
def test_words_and_weights(text: str, objective: ObjectiveSpec) -> None:
    assert read_objective(text) == objective


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("speed", "objective"),
        ("", "objective"),
        ("exposure=1,exposure=2", "objective"),
        ("measured=1", "objective"),
        ("exposure=x", "exposure"),
        ("time=0", "objective"),
        ("time=nan", "time"),
        ("exposure=101", "exposure"),
        ("max_density=-1", "max_density"),
    ],
)
def test_objectives_are_refused(text: str, field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        read_objective(text)
    assert caught.value.field == field
    assert "Spec" not in str(caught.value)  # no name of the code
