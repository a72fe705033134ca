"""Boundary velocities that meet limits: the path nearest to the given states, the fastest or the smoothest."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.design.tuning import multistart
from qtraj.design.tuning.advisor import Advisor
from qtraj.design.tuning.box import Bounds, box, require_names, weights_of
from qtraj.design.tuning.checks import ill_posed, require_choices, require_sound
from qtraj.design.tuning.ended import outcome_of
from qtraj.design.tuning.methods import Method, method_of
from qtraj.design.tuning.motions.motion import AbstractMotion
from qtraj.design.tuning.motions.registry import motion_of
from qtraj.design.tuning.multistart import take
from qtraj.design.tuning.objectives.registry import Objective, objective_of
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning.problem import Problem, pose
from qtraj.design.tuning.task import Task, by_slots, names_of, present
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.progress import Report, throttled
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState
from qtraj.path.boundary_problem import whole_turns
from qtraj.path.placement import Placement

SMALLEST_BATCH = 8
"""Batches are filled up to a power of two from here on, so that most sizes share what is compiled."""


def tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: Objective = "nearest",
    motion: str | AbstractMotion = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
    *,
    fixed: Sequence[str] = (),
    bounds: Bounds | None = None,
    weights: Mapping[str, float] | None = None,
    corridor: ArrayInput | None = None,
    starts: int = 8,
    method: Method | None = None,
    max_steps: int = 300,
    inner_steps: int = 200,
    progress: Report | None = None,
    throw: bool = False,
) -> Tuned:
    """Tune the boundary velocities between two positions until `limits` hold on the whole path.

    `objective`: "nearest" (least change of the six cylindrical velocity components at the ends; for hermite motion
    also of the duration), "fastest" (the duration), "smoothest" (∫|r⃛|²dt at fixed duration), or a differentiable
    callable of a path. `motion`: "uniform" moves V_ρ, V_h at both ends and the one rate ω; "hermite" moves all six
    components and, unless the objective is "smoothest", the duration. `duration` [s]: T₀ of "hermite", and the held
    duration of "smoothest"; by default the turn over the rate of the given states, whose V_φ/ρ need not agree. The
    turn has the sense of V_φ at the start, a magnitude in (0, 2π), and `turns` whole turns besides; where it is known,
    `turn` [rad, signed] gives it instead. The axis is the z axis of `placement`, by default the world's: give one where
    the states are far from that, such as `axis_between(start, end)`.

    The variables have names: "start.V_rho", "start.V_phi", "start.V_h", the same of "end" [m/s, about the axis], and
    "duration" [s]; uniform motion has no V_phi, which follows from the duration. `fixed` names those that keep their
    given value, and also takes "start.heading" and "end.heading": there the direction of the horizontal velocity stays
    and its magnitude is free, so that a turn can be driven slower on the same street. `bounds` maps names to (lowest,
    highest), either of which may be None; `weights` multiplies the squared changes that "nearest" sums.

    `corridor` [m] bounds how far the path departs from the given one, from which the search starts: the distance at
    equal fractions of the two durations, counted along the arc (which is no shorter), is at most that. It is one more
    limit, proved like the others, and stands last in the certificate.

    `starts` searches begin at the given states and about them, and the best is kept. Where no path meets the limits,
    the one that breaks them least is given, with advice. `progress` is called with a `Progress` a few times a second.

    `method` is "sqp", sequential quadratic programming on refined peaks with exact second derivatives: the default,
    and by far the fastest. Or it is any `optax.GradientTransformation`, such as `optax.adam(1e-2)`, a chain, or
    "lbfgs", which is `optax.lbfgs()`: an augmented Lagrangian in rounds of at most `inner_steps` steps of that
    optimiser, which asks for first derivatives only. It is the default for a callable objective, which need not be
    twice differentiable. `max_steps` counts steps of "sqp", and rounds of the others. Keep an optimiser to use it
    again: what is compiled belongs to the object.

    **Batches**: states with lanes in front (`jax.vmap(BoundaryState)(positions, velocities)`), and limits, duration,
    turn and placement with the same lanes or shared, give an outcome with lanes, one compiled search for all. An
    element whose data make no problem has the status "ill-posed", a path of NaN, and its reason in `result`.
    **Traces**: under `jit`, `vmap` and `grad` the same search runs on whole arrays, and the derivatives of its path in
    the boundary data and the limits are those of the solution (implicit function theorem), by whatever method it was
    found; infeasible problems are not looked into.

    **Raises:** ValueError for input that makes no problem, or in float32. A problem without a solution is no error:
    its `status` is "infeasible" and its `result` says why and what would help. RuntimeError with `throw` where the
    status of a problem is not "converged".
    """
    aim, motion = objective_of(objective), motion_of(motion)
    require_choices(start, end, limits, aim, motion, duration is not None)
    search = method_of(method, aim.is_smooth, max_steps, inner_steps)
    bounds = dict(bounds or {})
    require_names(motion, aim, fixed, bounds)
    if starts < 1:
        raise ValueError(f"starts must be 1 or more, but {starts} was given")
    weighed = weights_of(weights or {}, aim, motion)
    duration, turn, corridor = (None if x is None else as_float(x) for x in (duration, turn, corridor))

    start, end, batch = _stacked(start, end)
    known = (duration, turn, Placement() if placement is None else placement, _as_floats(bounds))
    _require_batch((*known, limits, corridor), batch)
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((start, end, known, limits, corridor)))
    count = start.position.shape[0]
    size = count if traced or not batch else _bucket(count)
    data, axes = _filled((start, end, *known), batch, size)
    # A callable objective may hold arrays, which are constants of the problem: it is not traced.
    posed = _posed_once if aim.is_smooth else _posed
    problem, low, high = posed(data, axes, aim, motion, whole_turns(turns), tuple(fixed), weighed)
    xp: Any = jnp if traced else np
    aims = by_slots(limits, corridor, count)
    aims = xp.concatenate([aims, xp.repeat(aims[-1:], size - count, axis=0)])
    tasks = Task(problem, aims, low, high, xp.ones(size))
    names = names_of(limits, corridor)
    which = present(names)
    given = take(problem, slice(0, count) if batch else 0)
    if not (traced or batch):
        require_sound(given, turn, limits, corridor, placement is not None)
    faults = ill_posed(given, turn, limits, corridor, placement is not None)
    if traced:
        found = multistart.best_of(search, jax.lax.stop_gradient(tasks), which, starts)
        outcome = outcome_of(tasks, limits, corridor, found, start, end, batch, placement, faults)
        return outcome.check() if throw else outcome
    own = jax.tree.map(lambda x: np.asarray(x)[:count], tasks)
    tell = None if progress is None else throttled(progress)
    found = multistart.best_of_each(search, own, which, starts, max_steps, tell)
    filled = jax.tree.map(lambda x: np.concatenate([x, np.repeat(x[-1:], size - count, axis=0)]), found)
    outcome = outcome_of(tasks, limits, corridor, filled, data[0], data[1], batch, placement, faults)
    advisor = Advisor(own, which, names, found, starts, max_steps, bounds)
    if batch:
        place = np.stack([np.full(count, advisor.number), np.arange(count)], axis=1)
        outcome = dataclasses.replace(outcome, advisor=advisor, place=place)
    else:
        outcome = dataclasses.replace(outcome, advice=advisor(0, ResultCode(int(outcome.code)), tell))
    return outcome.check() if throw else outcome


def _posed(
    data: tuple[Any, ...],
    axes: tuple[Any, ...],
    objective: Any,
    motion: AbstractMotion,
    turns: int,
    fixed: tuple[str, ...],
    weights: Float[Array, " 7"],
) -> tuple[Problem, Array, Array]:
    """The problems and the boxes of their variables."""

    def one(
        start: Any, end: Any, duration: Any, turn: Any, placement: Any, bounds: Any
    ) -> tuple[Problem, Array, Array]:
        problem = pose(start, end, objective, motion, duration, turns, placement, turn, weights, fixed)
        return problem, *box(problem, fixed, bounds)

    return eqx.filter_vmap(one, in_axes=axes)(*data)


_posed_once = eqx.filter_jit(_posed)


def _bucket(count: int) -> int:
    """The size to which a batch is filled up."""
    return max(SMALLEST_BATCH, 1 << (count - 1).bit_length())


def _stacked(start: BoundaryState, end: BoundaryState) -> tuple[BoundaryState, BoundaryState, tuple[int, ...]]:
    """Both states as a batch, and its shape: () for one problem.

    **Raises:** ValueError in lower precision than float64, and for batches that are empty or do not agree.
    """
    for state in (start, end):
        if state.position.dtype != jnp.float64:
            raise ValueError(
                f"tuning needs float64, but these states are in {state.position.dtype}. Call "
                "jax.config.update('jax_enable_x64', True) before building them."
            )
    shapes = {state.position.shape[:-1] for state in (start, end)} - {()}
    if len(shapes) > 1 or any(len(shape) != 1 or shape[0] == 0 for shape in shapes):
        raise ValueError(
            f"the states must have one batch axis, the same for both or none: shapes {start.position.shape} and "
            f"{end.position.shape} were given"
        )
    batch: tuple[int, ...] = shapes.pop() if shapes else ()
    count = batch[0] if batch else 1
    both = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, 3)), (start, end))
    return *both, batch


def _as_floats(bounds: Bounds) -> Any:
    return {name: tuple(None if x is None else as_float(x) for x in pair) for name, pair in bounds.items()}


def _require_batch(shared: tuple[Any, ...], batch: tuple[int, ...]) -> None:
    """Raise a ValueError for data whose batch is not that of the states."""
    for each in shared:
        plain = int(isinstance(each, Placement))
        for x in jax.tree.leaves(each):
            if x.ndim != plain and x.shape[: x.ndim - plain] != batch:
                raise ValueError(
                    f"the states have the batch {batch}, but other data have the shape {x.shape}: stack the states "
                    "likewise"
                )


def _filled(parts: tuple[Any, ...], batch: tuple[int, ...], size: int) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """The data of a batch filled up to a size by its last element, and the batch axis of every array (None: shared)."""

    def filled(x: Any, plain: int) -> Any:
        missing = size - x.shape[0] if x.ndim > plain else 0
        if missing == 0:
            return x
        return as_array(np.concatenate([x, np.repeat(np.asarray(x)[-1:], missing, axis=0)]), x.dtype)

    data, axes = [], []
    for each in parts:
        plain = int(isinstance(each, BoundaryState | Placement))
        data.append(jax.tree.map(lambda x, plain=plain: filled(x, plain), each))
        axes.append(jax.tree.map(lambda x, plain=plain: 0 if x.ndim > plain else None, each))
    return tuple(data), tuple(axes)
