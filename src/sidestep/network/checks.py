"""Checks that networks and towns have in common."""

import numpy as np
from jaxtyping import Bool, Int, Shaped

from sidestep.errors import SidestepError


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


def check_edges(
    error: type[SidestepError],
    item: str,
    nodes: int,
    *,
    ends: dict[str, Int[np.ndarray, " edge"]],
    metres: dict[str, Shaped[np.ndarray, " edge"]],
) -> None:
    """Raise an error unless edges join two different known nodes, and their measures are positive.

    Parameters
    ----------
    error
        What to raise.
    item
        What an edge is called.
    nodes
        Number of nodes.
    ends
        Nodes where edges begin, then where they end, by the name of the field.
    metres
        Measures by the name of the field.
    """
    for field, node in ends.items():
        check_each(error, item, field, node, (node >= 0) & (node < nodes), f"be a node, 0 to {nodes - 1}")
    tail, head = ends.values()
    check_each(error, item, "head", head, tail != head, "differ from the tail")
    for field, value in metres.items():
        check_each(error, item, field, value, np.isfinite(value) & (value > 0), "be a positive number of metres")
