"""Learning curves in plain characters."""

import math
from collections.abc import Mapping, Sequence

WIDTH, HEIGHT = 80, 16
"""Columns with the labels, and rows of points."""
MARKS = "*o+x"
"""One for each curve; where two meet, the first one's."""
_LABEL = 9
_WIDE = 4.0
"""Ratio of the largest value to the least from which on the scale is logarithmic: early walks often do not arrive."""


def plot(curves: Mapping[str, Sequence[float]]) -> str:
    """Draw curves over rounds, the first round at the left.

    Parameters
    ----------
    curves
        Positive values round by round, by name. Where there are more rounds than columns, each column is a mean.

    Returns
    -------
    str
        Lines of at most 80 characters; empty where no curve has a value.
    """
    longest = max(map(len, curves.values()), default=0)
    if not longest:
        return ""
    columns = min(longest, WIDTH - _LABEL - 1)
    shown = {name: _columns(values, columns / longest) for name, values in curves.items()}
    every = [value for values in shown.values() for value in values if value is not None]
    low, high = min(every), max(every)
    scale = math.log if low > 0 and high > _WIDE * low else float
    bottom, span = scale(low), (scale(high) - scale(low)) or 1.0
    grid = [[" "] * columns for _ in range(HEIGHT)]
    for mark, values in reversed([*zip(MARKS, shown.values(), strict=False)]):
        for column, value in enumerate(values):
            if value is not None:
                grid[round((HEIGHT - 1) * (1 - (scale(value) - bottom) / span))][column] = mark
    unscaled = math.exp if scale is math.log else float
    labels = {row: unscaled(bottom + span * (1 - row / (HEIGHT - 1))) for row in (0, 5, 10, HEIGHT - 1)}
    lines = [
        f"{f'{labels[row]:,.1f}' if row in labels else '':>{_LABEL}}|{''.join(points).rstrip()}"
        for row, points in enumerate(grid)
    ]
    last = f"round {longest:,}"
    axis = f"{'':{_LABEL}}+{'-' * columns}\n{'':{_LABEL}} {'1':<{max(columns - len(last), 2)}}{last}"
    legend = [f"{'':{_LABEL}} {mark} {name}" for mark, name in zip(MARKS, curves, strict=False)]
    return "\n".join([*lines, axis, *(legend if len(curves) > 1 else [])])


def _columns(values: Sequence[float], each: float) -> list[float | None]:
    """Means of the values that fall into each column, so many columns a value; None where there is none."""
    binned: list[list[float]] = [[] for _ in range(math.ceil(len(values) * each - 1e-9))]
    for number, value in enumerate(values):
        binned[min(int(number * each), len(binned) - 1)].append(value)
    return [sum(found) / len(found) if found else None for found in binned]
