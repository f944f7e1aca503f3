"""Routers for the walkers and objectives that are asked for: a few are kept."""

import ctypes
import gc
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import jax

from sidestep import programs
from sidestep.routing.request import at_fault
from sidestep.routing.router import Router
from sidestep.scenarios.model import Scenario, read_objective
from sidestep.scenarios.walkers import read_walkers
from sidestep.server.problems import ProblemError

MOST_VARIANTS = 4
"""Routers for other walkers and objectives that are kept."""
MOST_MADE = 16
"""Such routers that are made until compiled programs are forgotten: many are made for one of them only."""


class Variants:
    """The router of a scenario, and those of the same with another walker or objective.

    Parameters
    ----------
    router
        That of the scenario itself.
    begin
        Is called with each other one before it is used.
    """

    def __init__(self, router: Router, begin: Callable[[Router], object]) -> None:
        self._router, self._begin, self._scenario = router, begin, router.scenario
        self._variants: OrderedDict[Scenario, Router] = OrderedDict()
        self._lock, self._making, self._made = threading.Lock(), threading.Lock(), 0

    def __iter__(self) -> Iterator[Router]:
        with self._lock:
            return iter([self._router, *self._variants.values()])

    def router(self, walker: str | None, objective: str | None) -> Router:
        """The router for a walker and an objective, as people write them; by default the scenario's own.

        Parameters
        ----------
        walker, objective
            Texts, or None.

        Returns
        -------
        Router
            Made once, as long as not too many others are asked for.

        Raises
        ------
        SidestepError
            Words that name none (field ``walker`` or ``objective``).
        """
        scenario = self._changed(walker, objective)
        if scenario == self._scenario:
            return self._router
        if (found := self._kept(scenario)) is not None:
            return found
        with self._making:
            if (found := self._kept(scenario)) is not None:
                return found
            found = Router(scenario)
            assert found.quick  # noqa: S101 - made here, where nobody waits for it
            self._begin(found)
            with self._lock:
                self._variants[scenario] = found
                if len(self._variants) > MOST_VARIANTS:
                    self._variants.popitem(last=False)
            self._made += 1
            if self._made % MOST_MADE == 0:
                forget_programs()
        return found

    def is_made(self, walker: str | None, objective: str | None = None) -> bool:
        """Whether a router for a walker and an objective is there already."""
        scenario = self._changed(walker, objective)
        return scenario == self._scenario or self._kept(scenario) is not None

    def _kept(self, scenario: Scenario) -> Router | None:
        with self._lock:
            found = self._variants.get(scenario)
            if found is not None:
                self._variants.move_to_end(scenario)
        return found

    def _changed(self, walker: str | None, objective: str | None) -> Scenario:
        changes: dict[str, Any] = {}
        if walker is not None:
            with at_fault("walker"):
                walkers = read_walkers(walker, self._scenario.walker)
            if len(walkers) != 1:
                raise ProblemError(400, "one walker walks at a time", field="walker")
            changes["walker"] = walkers[0]
        if objective is not None:
            with at_fault("objective"):
                changes["objective"] = read_objective(objective)
        return self._scenario.changed(**changes) if changes else self._scenario


def forget_programs() -> None:
    """Forget compiled programs, and give the system what they took; those that are needed are read from disk again."""
    programs.clear_caches()
    jax.clear_caches()  # type: ignore[no-untyped-call]
    gc.collect()
    with suppress(OSError, AttributeError):  # systems without glibc
        ctypes.CDLL(None).malloc_trim(0)
