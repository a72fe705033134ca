"""Create the functions of common sweeps: evaluations, proofs, tunings, retimings and closed loops of many points.

Each function of this module takes a function of one point and returns a function of a batch of points for `sweep`. It
calls ours once for the batch where that is possible. In `tune`, `tune_route` and `retime`, points whose function raises
a ValueError fail.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import numpy as np

from qtraj.batch.evaluate import evaluate as evaluate_paths
from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify as certify_paths
from qtraj.foundation.argument import require_whole
from qtraj.path.channel import CHANNELS
from qtraj.sweeps import results
from qtraj.sweeps.digests import digest

Point = Mapping[str, Any]
Points = Mapping[str, np.ndarray]

FLIGHTS = 256
"""Number of closed loops that are simulated at once."""


@dataclass(frozen=True)
class Ready:
    """A function of a batch of points: `compute` with `options`, for a function `problem` of one point."""

    compute: Callable[..., dict[str, Any]]
    problem: Any
    options: Mapping[str, Any]
    shard: int
    units: Mapping[str, str] = field(default_factory=lambda: results.UNITS)
    batch: ClassVar[bool] = True

    def __call__(self, points: Points) -> dict[str, Any]:
        """Return the outputs of all points."""
        return self.compute(self.problem, points, **self.options)


def evaluate(
    path: Callable[[Point], Any],
    outputs: Sequence[str] = ("speed", "curvature"),
    reduce: str = "max",
    instants: int = 65,
    **options: Any,
) -> Ready:
    """Return a function for `sweep` that evaluates a path at each point, and reduces its outputs over time.

    Args:
        path: A function of a point that returns its path, such as `SpiralHelix.hermite(…)`, with the functions of JAX
            only, because it is compiled for all points at once.
        outputs: The names of outputs of `qtraj.evaluate`, which are also those of the result.
        reduce: "max", "min", "integral" or "mean" over the instants; see `qtraj.evaluate`.
        instants: The number of instants from the start to the end of each path.
        **options: Further arguments of `qtraj.evaluate`, such as `frame` and `vehicle`.

    Raises:
        ValueError: If `instants` is not a whole number of at least 2.

    Example:
        >>> from qtraj import SpiralHelix, sweeps
        >>> function = sweeps.evaluate(lambda p: SpiralHelix([p["radius"]], [0.0, 1.0], [0.0], 2.0), ["curvature"])
        >>> function({"radius": np.array([2.0, 4.0])})["curvature"].tolist()
        [0.5, 0.25]
    """
    require_whole(instants, "instants", 2)
    units = {name: CHANNELS[name].unit for name in outputs if name in CHANNELS and reduce != "integral"}
    options = {"outputs": tuple(outputs), "reduce": reduce, "instants": instants, **options}
    return Ready(_evaluated, path, options, 1 << 16, units)


def certify(path: Callable[[Point], Any], limits: Limits | Callable[[Point], Limits]) -> Ready:
    """Return a function for `sweep` that checks limits on the path of each point.

    The outputs are `holds` (whether all limits are proved to be satisfied) and for each limit, such as the curvature,
    its worst value `worst_curvature` and the time of that value `worst_curvature_time` [s].

    Args:
        path: A function of a point that returns its path, with the functions of JAX only, because it is compiled for
            all points at once.
        limits: The limits, or a function of a point that returns them.

    Example:
        >>> from qtraj import Limits, SpiralHelix, sweeps
        >>> circle = lambda p: SpiralHelix([p["radius"]], [0.0, 1.0], [0.0], 2.0)
        >>> function = sweeps.certify(circle, Limits(speed=3.0))
        >>> function({"radius": np.array([2.0, 4.0])})["holds"].tolist()
        [True, False]
    """
    return Ready(_certified, path, {"limits": limits}, 8192)


def tune(problem: Callable[[Point], tuple[Any, Any, Limits]], **options: Any) -> Ready:
    """Return a function for `sweep` that tunes the boundary velocities of each point.

    The outputs are `objective`, `duration` [s], `holds`, the `code` of the result (see `ResultCode`), the velocities
    `start_velocity` and `end_velocity` [m/s], and the worst value of each limit, such as `worst_curvature`. Points
    without a solution count as failed.

    Args:
        problem: A function of a point that returns (start, end, limits), the first arguments of `qtraj.tune`.
        **options: Further arguments of `qtraj.tune`, equal for all points, such as `motion` and `starts`.

    Example:
        >>> from qtraj import BoundaryState, Limits, sweeps
        >>> def turn(p):
        ...     start = BoundaryState([10.0, 0.0, 0.0], [0.0, p["speed"], 0.0])
        ...     return start, BoundaryState([0.0, 10.0, 0.0], [-p["speed"], 0.0, 0.0]), Limits(lateral_acceleration=2.0)
        >>> function = sweeps.tune(turn, starts=2)
        >>> function({"speed": np.array([4.0, 6.0])})["holds"].tolist()
        [True, True]
    """
    return Ready(_tuned, problem, options, 1024)


def tune_route(problem: Callable[[Point], tuple[Any, Limits]], **options: Any) -> Ready:
    """Return a function for `sweep` that tunes the route of each point, one after the other.

    The outputs are `objective`, `duration` [s], `holds`, `code` and the worst value of each limit; points without a
    solution count as failed.

    Args:
        problem: A function of a point that returns (route, limits), the first arguments of `qtraj.tune_route`.
        **options: Further arguments of `qtraj.tune_route`, equal for all points, such as `tube`.

    Example:
        >>> from qtraj import Limits, Route, sweeps
        >>> def street(p):
        ...     times, still = [0.0, 2.0, 4.0], [[0.0, 0.0, 0.0]] * 3
        ...     points, speeds = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [16.0, 3.0, 0.0]], [[4.0, 0.5, 0.0]] * 3
        ...     return Route(times, points, speeds, still), Limits(acceleration=p["acceleration"])
        >>> sweeps.tune_route(street)({"acceleration": np.array([9.0])})["holds"].tolist()
        [True]
    """
    return Ready(_each_route, problem, options, 64)


def retime(problem: Callable[[Point], tuple[Any, Limits]], **options: Any) -> Ready:
    """Return a function for `sweep` that computes the fastest timing of the path of each point, one after the other.

    The outputs are `duration` [s], `start_speed`, `end_speed` [m/s], `holds`, `code` and the worst value of each limit;
    points without a solution count as failed.

    Args:
        problem: A function of a point that returns (path, limits), the first arguments of `qtraj.retime`.
        **options: Further arguments of `qtraj.retime`, equal for all points, such as `start_speed`.

    Example:
        >>> from qtraj import Limits, SpiralHelix, sweeps
        >>> circle = SpiralHelix([4.0], [0.0, 1.0], [0.0], 2.0)
        >>> function = sweeps.retime(lambda p: (circle, Limits(speed=p["speed"])))
        >>> function({"speed": np.array([2.0, 4.0])})["duration"].round(3).tolist()
        [4.0, 2.0]
    """
    return Ready(_each_timing, problem, options, 256)


def simulate(flight: Callable[[Point], Any]) -> Ready:
    """Return a function for `sweep` that simulates a closed loop at each point, compiled and in batches.

    The outputs are `final_angle` and `peak_angle` [rad], the last and the largest attitude error, `peak_command`, and
    `code`; flights that do not reach their last instant count as failed.

    Args:
        flight: A function of a point that returns the `Solution` of `qtraj.simulate`, with the functions of JAX only.
            For random sensors, a parameter such as `{"seed": np.arange(1000)}` gives each flight a key,
            `jax.random.key(point["seed"])`.

    Example:
        >>> import qtraj as qt
        >>> slew = qt.EulerTurn([1.0, 0, 0, 0], [1.0, 1, 0, 0], qt.Quintic(duration=2.0))
        >>> law = qt.AccelerationLaw(4.0, 4.0)
        >>> def flight(p):
        ...     start = qt.quaternion.exp(p["error"] * np.array([1.0, 0, 0]))
        ...     return qt.simulate(slew, law, start, np.zeros(3), np.array([0.0, 2.0]))
        >>> simulated = qt.sweeps.simulate(flight)({"error": np.array([0.0, 0.1])})
        >>> simulated["final_angle"].round(2).tolist()
        [0.0, 0.02]
    """
    return Ready(_simulated, flight, {}, 16 * FLIGHTS)


def _evaluated(path: Any, points: Points, outputs: Any, reduce: str, instants: int, **options: Any) -> dict[str, Any]:
    paths = _mapped(path, points)
    times = np.linspace(0.0, 1.0, instants) * np.asarray(paths.duration)[:, None]
    reduced = evaluate_paths(paths, times, outputs, reduce=reduce, **options)
    return {name: np.asarray(reduced[name]) for name in outputs}


def _certified(path: Any, points: Points, limits: Any) -> dict[str, Any]:
    checked = certify_paths(_mapped(path, points), limits if isinstance(limits, Limits) else _mapped(limits, points))
    times = {f"worst_{name}_time": np.asarray(time) for name, (time, _, _) in checked.worst.items()}
    return {**results.of_certificate(checked), **times}


def _tuned(problem: Any, points: Points, **options: Any) -> dict[str, Any]:
    from qtraj.design.tuning.tune import tune as tune_states  # imported here, because it imports optax

    def run(problems: list[Any]) -> results.Outputs:
        return results.of_tuned(tune_states(*jax.tree.map(lambda *x: np.stack(x), *problems), **options))

    each = _each(points)
    return results.computed(run, results.valid(problem, dict(enumerate(each))), len(each))


def _each_route(problem: Any, points: Points, **options: Any) -> dict[str, Any]:
    from qtraj.design.tuning_route.tune_route import tune_route as tune_one

    return _one_by_one(lambda point: results.of_route(tune_one(*problem(point), **options)), points)


def _each_timing(problem: Any, points: Points, **options: Any) -> dict[str, Any]:
    from qtraj.design.timing.retime import retime as retime_one

    def timed(point: Point) -> results.Outputs:
        found = retime_one(*problem(point), **options)
        return results.of_timing(found, found.certificate)

    return _one_by_one(timed, points)


def _one_by_one(function: Callable[[Point], results.Outputs], points: Points) -> results.Outputs:
    each = _each(points)
    found = results.valid(function, dict(enumerate(each)))
    return results.spread(results.stacked([*found.values()]), [*found], len(each))


def _simulated(flight: Any, points: Points) -> dict[str, Any]:
    mapped, count = _compiled(flight, _motion_of), len(next(iter(points.values())))
    parts = []
    for first in range(0, count, FLIGHTS):  # blocks of one size, which is compiled once
        at = np.minimum(np.arange(first, first + min(FLIGHTS, count)), count - 1)
        parts.append(jax.tree.map(np.asarray, mapped({name: values[at] for name, values in points.items()})))
    return results.of_flights(*(np.concatenate(x)[:count] for x in zip(*parts, strict=True)))


def _mapped(function: Callable[[Point], Any], points: Points) -> Any:
    """Return the results of a function of one point for all points, as one pytree of NumPy arrays."""
    return jax.tree.map(np.asarray, _compiled(function)(dict(points)))


MOST_EXECUTABLES = 32

_EXECUTABLES: dict[str, Callable[..., Any]] = {}
"""Compiled functions by the digests of what they compute: a function that reads changed variables is another one."""


def _compiled(
    function: Callable[[Point], Any], shaped: Callable[[Any], Any] = lambda function: function
) -> Callable[..., Any]:
    """Return `shaped(function)`, compiled for a batch; the cache keeps the executables for all shards."""
    key = digest((shaped, function))
    if key not in _EXECUTABLES:
        if len(_EXECUTABLES) >= MOST_EXECUTABLES:
            _EXECUTABLES.clear()
        _EXECUTABLES[key] = jax.jit(jax.vmap(shaped(function)))
    return _EXECUTABLES[key]


def _motion_of(flight: Callable[[Point], Any]) -> Callable[[Point], Any]:
    def run(point: Point) -> Any:
        motion = flight(point)
        return motion.angle, motion.peak_command, motion.code

    return run


def _each(points: Points) -> list[dict[str, Any]]:
    names, columns = [*points], [values.tolist() for values in points.values()]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
