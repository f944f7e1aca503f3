"""Walks that are chosen by ``reset(options=…)`` instead of drawn."""

import operator
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sidestep.arguments import brief
from sidestep.environment.types import Instance
from sidestep.errors import hint
from sidestep.evaluation.compare import CHUNK, TOWN_CHUNK
from sidestep.gym.options import EnvError
from sidestep.gym.task import Task
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import check_ways

CHOICES = ("walk", "future", "origin", "destination", "departure")
"""What may be chosen of a walk."""
MOST_NAMED = 8


class Chosen(NamedTuple):
    """One walk on the host."""

    origin: int
    destination: int
    departure: float
    future: int


def rows_of(walks: Instance) -> list[Chosen]:
    """Walks on the host, one by one."""
    columns = (walks.origin, walks.destination, walks.departure, walks.future)
    return [Chosen(*row) for row in zip(*(np.asarray(column).tolist() for column in columns), strict=True)]


class Walks:
    """The walks that a task has, for checks of those that are asked for."""

    def __init__(self, task: Task, latest: float) -> None:
        network, sampler = task.params.network, task.sampler
        self.latest = latest
        """The latest departure, s."""
        self.begins, self.ends = np.asarray(sampler.origins), np.asarray(sampler.destinations)
        self.futures, self.counts = np.asarray(sampler.futures), np.asarray(sampler.counts)
        self.row_of_future = np.asarray(task.params.futures.destination)
        self.destinations = np.asarray(task.destinations)
        self.tests = rows_of(task.tests)
        self.part = np.repeat(np.arange(len(task.parts)), task.parts)
        self._network = network
        self._led: set[tuple[int, int]] = set()  # origins and destinations with a path between them

    @property
    def nodes(self) -> int:
        """Crossings of the map."""
        return len(self.part)

    def chosen(self, drawn: Chosen, options: Mapping[str, Any]) -> Chosen:
        """Replace what was drawn of a walk by what is asked for.

        A walk of a comparison leaves nothing else to choose. A future serves one destination: where only one of both is
        given, the other follows. An origin that was drawn is drawn anew for another destination.

        Parameters
        ----------
        drawn, options
            The walk, and the wishes: some of ``CHOICES``.

        Returns
        -------
        Chosen
            A walk that can be walked.

        Raises
        ------
        EnvError
            Wishes that are unknown, out of range, or do not fit together, with the wish as their field.
        """
        if options.get("walk") is not None:
            self._check_compared(options)
        if (walk := self._number(options, "walk", len(self.tests))) is not None:
            return self.tests[walk]
        future = self._number(options, "future", len(self.row_of_future))
        origin, end = (self._number(options, name, self.nodes) for name in ("origin", "destination"))
        departure = drawn.departure if options.get("departure") is None else self._departure(options["departure"])
        row = int(self.row_of_future[drawn.future if future is None else future])
        if end is not None and end not in self.destinations[row]:
            asked = self._row_of(end)
            if future is not None:
                there = ", ".join(map(str, self.destinations[row].tolist()))
                raise EnvError(
                    f"future {future} is for walks to node {there}, not {end}; leave out one", field="future"
                )
            row = asked
        if origin is not None and end is None and future is None:  # nobody goes to where they are
            elsewhere = np.flatnonzero(self.destinations[:, self.part[origin]] != origin)
            row = row if row in elsewhere or not len(elsewhere) else int(elsewhere[drawn.future % len(elsewhere)])
        if future is None:
            future = drawn.future
            if self.row_of_future[future] != row:
                future = int(self.futures[row, drawn.future % self.counts[row]])
        origin, end = self._ends(drawn, row, origin, end)
        return Chosen(origin, end, departure, future)

    def _check_compared(self, options: Mapping[str, Any]) -> None:
        others = [name for name, value in options.items() if name != "walk" and value is not None]
        if others:
            raise EnvError(f"walk decides the {others[0]} as well; leave out one of both", field="walk")
        if not self.tests:
            raise EnvError(
                f"walk needs purpose='test' and at most {CHUNK} futures, or {TOWN_CHUNK} above level position in towns",
                field="walk",
            )

    def _row_of(self, end: int) -> int:
        rows = np.flatnonzero((self.destinations == end).any(axis=1))
        if not len(rows):
            known = self.destinations.ravel()
            some = ", ".join(map(str, known[:MOST_NAMED].tolist())) + ", …" * (len(known) > MOST_NAMED)
            raise EnvError(f"destination must be one of this environment's ({some}), not {end}", field="destination")
        return int(rows[0])

    def _ends(self, drawn: Chosen, row: int, origin: int | None, end: int | None) -> tuple[int, int]:
        if origin is None:
            if drawn.destination in (self.destinations[row] if end is None else (end,)):
                return drawn.origin, drawn.destination
            among = np.flatnonzero(self.ends[row] == end) if end is not None else np.arange(self.ends.shape[1])
            number = among[drawn.origin % len(among)]
            return int(self.begins[row, number]), int(self.ends[row, number])
        there = int(self.destinations[row, self.part[origin]])
        if end not in (None, there):
            raise EnvError(
                f"no path leads from node {origin} to node {end}: they are on different maps", field="origin"
            )
        if origin == there:
            raise EnvError(f"origin must not be the destination, node {there}", field="origin")
        if (origin, there) not in self._led:
            try:
                check_ways(self._network, (origin,), (there,))
            except ScenarioError as error:
                raise EnvError(f"origin {origin} is no place to begin: {error}", field="origin") from error
            self._led.add((origin, there))
        return origin, there

    def _number(self, options: Mapping[str, Any], name: str, count: int) -> int | None:
        value = options.get(name)
        if value is None:
            return None
        try:
            number = operator.index(value)
        except TypeError:
            number = -1
        if isinstance(value, bool) or not 0 <= number < count:
            raise EnvError(f"{name} must be a whole number from 0 to {count - 1}, not {brief(value)}", field=name)
        return number

    def _departure(self, value: Any) -> float:
        try:
            seconds = float("nan") if isinstance(value, str | bytes | bool) else float(value)
        except (TypeError, ValueError, OverflowError):
            seconds = float("nan")
        if not 0 <= seconds <= self.latest:
            last = f"a number of seconds from 0 to {self.latest:g}, the scenario's latest departure"
            must = last if self.latest else "0, when all of the scenario's walks depart"
            raise EnvError(f"departure must be {must}, not {brief(value)}", field="departure")
        return seconds


def check_names(options: Any, known: tuple[str, ...]) -> Mapping[str, Any]:
    """Refuse options of a reset that mean nothing.

    Parameters
    ----------
    options, known
        What was given, and the names that there are.

    Returns
    -------
    Mapping[str, Any]
        The same; an empty one for None.

    Raises
    ------
    EnvError
        Unknown names, and anything but a dictionary.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise EnvError(f"options of reset must be a dictionary, not {brief(options)}", field="options")
    for name in options:
        if name not in known:
            raise EnvError(f"reset has no option {brief(name)}{hint(name, known)}", field=str(name))
    return options


def each_walker(options: Mapping[str, Any], walkers: int) -> list[dict[str, Any]]:
    """The wishes of each of several walkers: values are for all of them, or arrays with one for each.

    Parameters
    ----------
    options, walkers
        The wishes, and how many walkers there are.

    Returns
    -------
    list[dict[str, Any]]
        Those of each walker; none at all where there are no wishes.

    Raises
    ------
    EnvError
        Arrays of another length.
    """
    if not options:
        return []
    columns: dict[str, list[Any]] = {}
    for name, value in options.items():
        several = isinstance(value, list | tuple) or np.ndim(value) > 0
        if several and len(value) != walkers:
            raise EnvError(f"{name} must be one value or {walkers}, one for each walker, not {len(value)}", field=name)
        columns[name] = list(value) if several else [value] * walkers
    return [{name: column[number] for name, column in columns.items()} for number in range(walkers)]
