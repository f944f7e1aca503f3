"""Expected paces on one map, kept from question to question: they take longer to work out than most answers."""

from functools import lru_cache

from jaxtyping import Array, Float

from sidestep.scenarios.expectation import expected_pace
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import ObjectiveSpec, Scenario

KEPT = 16
"""Hours whose paces are kept, the latest ones."""


class Paces:
    """Expected paces on one map, hour by hour."""

    def __init__(self, scenario_map: ScenarioMap) -> None:
        self._map = scenario_map
        self._kept = lru_cache(KEPT)(self._work_out)

    def at(self, scenario: Scenario, hour: float) -> Float[Array, "segment step"] | None:
        """Give mean seconds for each metre, as :func:`sidestep.scenarios.expectation.expected_pace` does.

        Parameters
        ----------
        scenario
            The problem, which may end earlier than that of another question.
        hour
            Hour of the week at clock 0.

        Returns
        -------
        Float[Array, "segment step"] or None
            None where crowds come as they are expected.
        """
        return self._kept(scenario.changed(objective=ObjectiveSpec()), hour)  # which no pace depends on

    def _work_out(self, scenario: Scenario, hour: float) -> Float[Array, "segment step"] | None:
        return expected_pace(scenario, self._map, hour)
