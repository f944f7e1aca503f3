"""Pictures of walkers under way."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from sidestep.environment.types import EnvParams
from sidestep.gym.options import EnvOptions
from sidestep.gym.runner import Report
from sidestep.gym.task import Task
from sidestep.walking.crossing_time import slot_at


class Scene:
    """Where walkers have been, and pictures of it."""

    def __init__(self, task: Task, options: EnvOptions, walkers: int) -> None:
        self._params, self._options = task.params, options
        from sidestep.plotting import WalkPicture  # with matplotlib, which takes half a second

        window = options.render_mode == "human"
        self._picture = WalkPicture(task.params.network, task.params.free_speed, window=window)
        self._nodes: list[list[int]] = [[] for _ in range(walkers)]
        self._report: Report | None = None

    def follow(self, report: Report) -> None:
        """Remember where walkers are now, and show it if there is a window."""
        self._report = report
        for nodes, node, seconds in zip(self._nodes, report.node.tolist(), report.seconds.tolist(), strict=True):
            if not seconds:
                nodes.clear()
            nodes.append(node)

        if self._picture.window:
            self._draw(0)
            self._picture.show(1 / self._options.render_fps)

    def pixels(self, walker: int) -> UInt8[np.ndarray, "row column 3"] | None:
        """A walker and the crowds around it now; None where they are shown in the window already.

        Parameters
        ----------
        walker
            Its number.

        Returns
        -------
        UInt8[np.ndarray, "row column 3"] | None
            Red, green and blue.

        Raises
        ------
        gymnasium.error.ResetNeeded
            No walk has begun.
        """
        if self._report is None:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        if self._picture.window:
            return None
        self._draw(walker)
        return self._picture.pixels()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._picture.close()

    def _draw(self, walker: int) -> None:
        report = self._report
        if report is None:
            return
        seconds, end, future = report.seconds[walker], int(report.destination[walker]), report.future[walker]
        clock, node = report.departure[walker] + seconds, int(report.node[walker])
        speed = np.asarray(_speeds(self._params, jnp.int32(future), jnp.float32(clock)))
        what = f"{self._options.scenario.name}, future {future}: {seconds / 60:.1f} min"
        self._picture.update(what + ", arrived" * (node == end), self._nodes[walker], end, speed)


@jax.jit
def _speeds(params: EnvParams, future: Int[Array, ""], clock: Float[Array, ""]) -> Float[Array, " segment"]:
    """Speeds of walkers on all segments, m/s."""
    speeds = params.futures.speeds
    return speeds.at(future, jnp.arange(params.network.segments), slot_at(clock, speeds.slot_seconds, speeds.slots))


def scene_of(task: Task, options: EnvOptions, walkers: int) -> Scene | None:
    """Pictures of an environment; None where nobody asks for any."""
    return None if options.render_mode is None else Scene(task, options, walkers)
