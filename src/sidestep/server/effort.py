"""How much work one question may be."""

from sidestep.server.problems import ProblemError

SIZES = (1, 20, 50, 100, 200, 500, 1000)
"""Numbers of futures; others are rounded up, since programs are compiled for each."""
MOST_WORK = 10.0
"""Seconds of walking through futures that one question may take."""
WORK = {"expected": 1e-4, "shortest-path": 1e-4, "greedy-map": 1e-4, "forecast": 0.12}
"""Seconds of one walk through a future in a town of 2,500 streets, roughly."""
OTHERS_WORK = 2e-3
"""Those of planners that are not among them."""


def futures_of(planner: str, asked: int, times: int = 1) -> int:
    """Find out how many futures are simulated.

    Parameters
    ----------
    planner
        Who walks through them.
    asked
        How many are asked for.
    times
        How often they are walked through.

    Returns
    -------
    int
        The next of ``SIZES``.

    Raises
    ------
    ProblemError
        More walks than one question may take (field ``futures``).
    """
    size = next(each for each in SIZES if each >= asked)
    most = int(MOST_WORK / WORK.get(planner, OTHERS_WORK))
    if size * times > most:
        said = f"{size} futures are too many here for the planner {planner}"
        fits = [each for each in SIZES if each * times <= most]
        said += f"; ask for {fits[-1]} at most" if fits else "; choose another planner"
        raise ProblemError(400, said, field="futures")
    return size


def most_walks(planner: str, futures: int) -> int:
    """How often a planner may walk through some futures in one question."""
    return int(MOST_WORK / WORK.get(planner, OTHERS_WORK)) // futures
