"""Routers for the walkers and objectives that are asked for; a few are kept."""

import ctypes
import gc
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress

import jax

from sidestep import programs
from sidestep.routing.request import at_fault
from sidestep.routing.router import Router
from sidestep.scenarios.model import read_objective
from sidestep.scenarios.walkers import Walker, read_walkers
from sidestep.server.problems import ProblemError

MOST_VARIANTS = 4
"""Routers for other walkers that are kept; for another objective nothing is."""
MOST_MADE = 16
"""Such routers that are made until compiled programs are forgotten: many are made for one of them only."""


class Variants:
    """The router of a scenario, and those of the same with another walker or objective.

    Parameters
    ----------
    router
        That of the scenario itself.
    begin
        Is called with each other one before it is used, and again once it is kept, since what it begins from may
        have changed meanwhile.
    """

    def __init__(self, router: Router, begin: Callable[[Router], object]) -> None:
        self._router, self._begin = router, begin
        self._variants: OrderedDict[Walker, Router] = OrderedDict()
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
            For a walker made once, as long as not too many others are asked for.

        Raises
        ------
        SidestepError
            Words that name none (field ``walker`` or ``objective``).
        """
        if objective is None:
            return self._walking(self._walker(walker))
        with at_fault("objective"):
            wanted = read_objective(objective)
        return self._walking(self._walker(walker)).changed(objective=wanted)

    def is_made(self, walker: str | None) -> bool:
        """Whether a router for a walker is there already."""
        return self._kept(self._walker(walker)) is not None

    def _walking(self, walker: Walker) -> Router:
        if (found := self._kept(walker)) is not None:
            return found
        with self._making:
            if (found := self._kept(walker)) is not None:
                return found
            found = self._router.changed(walker=walker)
            assert found.quick  # noqa: S101 - made here, where nobody waits for it
            self._begin(found)
            with self._lock:
                self._variants[walker] = found
                if len(self._variants) > MOST_VARIANTS:
                    self._variants.popitem(last=False)
            self._begin(found)
            self._made += 1
            if self._made % MOST_MADE == 0:
                forget_programs()
        return found

    def _kept(self, walker: Walker) -> Router | None:
        if walker == self._router.scenario.walker:
            return self._router
        with self._lock:
            found = self._variants.get(walker)
            if found is not None:
                self._variants.move_to_end(walker)
        return found

    def _walker(self, given: str | None) -> Walker:
        own = self._router.scenario.walker
        if given is None:
            return own
        with at_fault("walker"):
            walkers = read_walkers(given, own)
        if len(walkers) != 1:
            raise ProblemError(400, "one walker walks at a time", field="walker")
        return walkers[0]


def forget_programs() -> None:
    """Forget compiled programs, and give the system what they took; those that are needed are read from disk again."""
    programs.clear_caches()
    jax.clear_caches()  # type: ignore[no-untyped-call]
    gc.collect()
    with suppress(OSError, AttributeError):  # systems without glibc
        ctypes.CDLL(None).malloc_trim(0)
