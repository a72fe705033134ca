"""Compute the outputs of many tasks of scenarios at once: what `qtraj sweep` runs at each point."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np

from qtraj.batch.evaluate import evaluate
from qtraj.design.proof.certify import certify
from qtraj.motion.simulation.simulate import simulate
from qtraj.scenario.loop import LoopTask
from qtraj.scenario.path import PathTask
from qtraj.scenario.route import RouteTask
from qtraj.scenario.sweep_batch import Together
from qtraj.sweeps import results
from qtraj.sweeps.digests import digest
from qtraj.sweeps.results import Outputs

INSTANTS = 65
"""Number of instants at which 'evaluate' evaluates a path."""


BATCHED = ("start", "end", "limits", "duration", "turn")
"""Arguments of `qtraj.tune` that may differ within a batch."""


def tuned(tasks: Sequence[PathTask]) -> Outputs:
    """Tune all tasks, in one batch if they differ in numbers only; with margins, one after the other."""
    from qtraj.design.tuning.tune import tune

    if any(task.deviations is not None for task in tasks):
        return results.stacked([results.of_robust(task.robust_tuned()) for task in tasks])
    arguments = [task.tuning() for task in tasks]
    shared = [{name: x for name, x in a.items() if name not in BATCHED} for a in arguments]
    own = [{name: a[name] for name in BATCHED} for a in arguments]
    if len({digest(x) for x in shared}) > 1 or (batch := _batch(own)) is None:
        return (
            results.joined([tuned([task]) for task in tasks])
            if len(tasks) > 1
            else _first(results.of_tuned(tune(**arguments[0])))
        )
    return results.of_tuned(tune(**batch, **shared[0]))


def certified(tasks: Sequence[PathTask]) -> Outputs:
    """Check the limits of all tasks, in one batch if their paths and limits differ in numbers only."""
    batch = _batch([{"path": task.path, "limits": task.limits} for task in tasks])
    if batch is None:
        return results.joined([results.of_certificate(_first(certify(task.path, task.limits))) for task in tasks])
    return results.of_certificate(certify(**batch))


def evaluated(tasks: Sequence[PathTask], outputs: tuple[str, ...], reduce: str) -> Outputs:
    """Evaluate the paths of all tasks, and reduce each output over time."""
    paths = _batch([{"path": task.path} for task in tasks])
    if paths is None:
        return results.joined([evaluated([task], outputs, reduce) for task in tasks])
    vehicles = _batch([{"vehicle": task.limits.vehicle} for task in tasks]) or {"vehicle": None}
    times = np.linspace(0.0, 1.0, INSTANTS) * np.asarray(paths["path"].duration)[:, None]
    reduced = evaluate(paths["path"], times, outputs, reduce=reduce, **vehicles)
    return {name: np.asarray(reduced[name]) for name in outputs}


def retimed(tasks: Sequence[PathTask]) -> Outputs:
    """Compute the fastest timing of the path of each task, and check all limits."""
    return results.stacked([_retimed(task) for task in tasks])


def _retimed(task: PathTask) -> Outputs:
    from qtraj.design.timing.own_requirements import imposable
    from qtraj.design.timing.retime import retime
    from qtraj.design.whole_certificate import whole_certificate

    timed = retime(task.path, imposable(task.path, task.limits))
    return results.of_timing(timed, whole_certificate(timed, task.limits))


def routed(tasks: Sequence[RouteTask]) -> Outputs:
    """Tune the route of each task.

    **Raises:** ValueError if the scenario has no table [tune].
    """
    if tasks[0].tuning is None:
        raise ValueError("a sweep of routes needs the table [tune] in the scenario")
    return results.stacked([_routed(task) for task in tasks])


def _routed(task: RouteTask) -> Outputs:
    if task.robust_tuning is not None:
        return results.of_robust(task.robust_tuning(lambda _: None), results.of_route)
    return results.of_route(task.tuning(lambda _: None)) if task.tuning else {}


FLIGHTS = 256
"""Number of closed loops that are simulated at once."""


def simulated(tasks: Sequence[LoopTask]) -> Outputs:
    """Simulate all closed loops, compiled in blocks of one size if they differ in numbers only."""
    arguments = [task.arguments() for task in tasks]
    fixed = ("times", "rtol", "atol", "sign")
    own = [{name: x for name, x in a.items() if name not in (*fixed, "settled")} for a in arguments]
    shared = [{name: a[name] for name in fixed} for a in arguments]
    batch = None if len({digest(x) for x in shared}) > 1 else _batch(own)
    if batch is None:
        return (
            results.joined([simulated([task]) for task in tasks]) if len(tasks) > 1 else _one_flight(own[0], shared[0])
        )
    run = _flight(digest(shared[0]), shared[0])
    parts, count = [], len(tasks)
    for first in range(0, count, FLIGHTS):
        at = np.minimum(np.arange(first, first + min(FLIGHTS, count)), count - 1)
        parts.append(jax.tree.map(np.asarray, run(jax.tree.map(lambda x, k=at: x[k], batch))))
    return results.of_flights(*(np.concatenate(x)[:count] for x in zip(*parts, strict=True)))


_COMPILED: dict[str, Callable[..., Any]] = {}


def _flight(key: str, shared: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the compiled simulation of a batch, which is kept for the next shards."""

    def run(own: dict[str, Any]) -> Any:
        motion = simulate(**own, **shared)
        return motion.angle, motion.peak_command, motion.code

    return _COMPILED.setdefault(key, jax.jit(jax.vmap(run)))


def _one_flight(own: Mapping[str, Any], shared: Mapping[str, Any]) -> Outputs:
    motion = simulate(**own, **shared)
    return results.of_flights(*(np.asarray(x)[None] for x in (motion.angle, motion.peak_command, motion.code)))


def together(run: str, points: Together, **options: Any) -> Outputs:
    """Return the outputs of points that are one batch; those that are ill-posed fail.

    The batch keeps its size, so that compiled functions are not compiled for every number of ill-posed points; these
    are replaced by the first point that is not.

    **Raises:** NoValidPointError if all of them are ill-posed.
    """
    count, good = len(points.ill_posed), np.flatnonzero(~points.ill_posed)
    if not len(good):
        raise results.NoValidPointError("the boundary states of all points are ill-posed")
    at = np.arange(count)
    if len(good) < count:
        at = np.where(points.ill_posed, good[0], at) if run == "evaluate" else good
    outputs = TOGETHER[run](points if len(good) == count else points.at(at), **options)
    if run == "evaluate" and len(good) < count:
        outputs = {name: values[good] for name, values in outputs.items()}
    return results.spread(outputs, good.tolist(), count)


def _tuned_together(points: Together) -> Outputs:
    from qtraj.design.tuning.tune import tune

    arguments: dict[str, Any] = points.task.tuning() | {"placement": points.placement}
    return results.of_tuned(tune(**arguments))


def _certified_together(points: Together) -> Outputs:
    return results.of_certificate(certify(points.task.path, points.task.limits))


def _evaluated_together(points: Together, outputs: tuple[str, ...], reduce: str) -> Outputs:
    task = points.task
    times = np.linspace(0.0, 1.0, INSTANTS) * np.asarray(task.path.duration)[:, None]
    reduced = evaluate(task.path, times, outputs, reduce=reduce, vehicle=task.limits.vehicle)
    return {name: np.asarray(reduced[name]) for name in outputs}


TOGETHER: dict[str, Callable[..., Outputs]] = {
    "tune": _tuned_together,
    "certify": _certified_together,
    "evaluate": _evaluated_together,
}
"""The runs of which many points can be one batch."""


RUNS: dict[str, Callable[..., Outputs]] = {
    "tune": tuned,
    "certify": certified,
    "evaluate": evaluated,
    "retime": retimed,
    "route": routed,
    "simulate": simulated,
}
"""The runs by name."""


def _batch(trees: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return trees of equal structure as one tree with a batch axis, or None if they cannot be one batch."""
    leaves, structure = jax.tree.flatten(trees[0])
    rows = [leaves]
    for tree in trees[1:]:
        others, own = jax.tree.flatten(tree)
        if own != structure or any(np.shape(a) != np.shape(b) for a, b in zip(leaves, others, strict=True)):
            return None
        rows.append(others)
    return jax.tree.unflatten(
        structure, [np.stack([np.asarray(x) for x in column]) for column in zip(*rows, strict=True)]
    )


def _first(tree: Any) -> Any:
    """Return a result as a batch of one."""
    return jax.tree.map(lambda x: np.asarray(x)[None], tree)
