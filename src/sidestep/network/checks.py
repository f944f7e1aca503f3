"""Checks that networks and towns have in common."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Shaped

from sidestep.arguments import Rule
from sidestep.errors import SidestepError


def array(kind: type[np.integer] | type[np.floating], must: str, *dimensions: int) -> Rule:
    """Arrays of finite numbers, and lists that can be such, as an array of one kind.

    Parameters
    ----------
    kind
        The kind of numbers. Numbers with decimals are no whole numbers.
    must
        What the array is called after "must be".
    *dimensions
        How many dimensions it may have.

    Returns
    -------
    Rule
        For :func:`sidestep.arguments.checked`.
    """

    def read(value: Any) -> np.ndarray:
        given = np.asarray(value)
        if not given.size:
            given = given.astype(kind)
        if given.dtype.kind not in ("iu" if issubclass(kind, np.integer) else "iuf") or given.ndim not in dimensions:
            raise TypeError
        return np.asarray(value, kind)

    return Rule(f"must be {must}", read)


def check_each(
    error: type[SidestepError],
    item: str,
    field: str,
    values: Shaped[np.ndarray, "item *more"],
    valid: Bool[np.ndarray, " item"],
    must: str,
) -> None:
    """Raise an error about the first invalid value of a field, if there is one.

    Parameters
    ----------
    error
        What to raise.
    item
        What the values belong to, such as "street".
    field, values, valid
        Name of the field, its value for each item, and which of them are valid.
    must
        Completes the sentence "it must".
    """
    if not valid.all():
        worst = int(np.argmin(valid))
        raise error(f"{field} of {item} {worst} is {values[worst]}; it must {must}", field=field)


def check_edges(error: type[SidestepError], item: str, nodes: int, columns: dict[str, Any]) -> None:
    """Raise an error unless edges join two different known nodes, and their measures are positive.

    Parameters
    ----------
    error
        What to raise.
    item
        What an edge is called.
    nodes
        Number of nodes.
    columns
        Arrays by the name of the field: ``tail`` and ``head``, where edges begin and end, ``length`` and ``width``.
    """
    for field in ("tail", "head"):
        node = columns[field]
        check_each(error, item, field, node, (node >= 0) & (node < nodes), f"be a node, 0 to {nodes - 1}")
    check_each(error, item, "head", columns["head"], columns["tail"] != columns["head"], "differ from the tail")
    for field in ("length", "width"):
        metres = columns[field]
        check_each(error, item, field, metres, np.isfinite(metres) & (metres > 0), "be a positive number of metres")
