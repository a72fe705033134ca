"""Define `retime_together`, which computes the fastest timing that several bodies share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate, require_float64
from qtraj.design.proof.certify import certify
from qtraj.design.timing.adaptive import on_chosen_cells
from qtraj.design.timing.bodies import rows_of_body
from qtraj.design.timing.constraints import POWERS
from qtraj.design.timing.ends import begun, known_speeds
from qtraj.design.timing.held import Solved, with_ends
from qtraj.design.timing.laps import require_lap
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.part_search import Posed, Searched, searched
from qtraj.design.timing.part_timing import SLOWER, fixed
from qtraj.design.timing.parts import Part, known_zero
from qtraj.design.timing.prescribed import gentlest, ratios
from qtraj.design.timing.requirements import (
    require_duration,
    require_knots,
    require_known_along,
    require_one_path,
    require_tolerance,
    speed_at,
)
from qtraj.design.timing.result_code import accuracy_code, result_code
from qtraj.design.timing.search import MARGIN
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.design.timing.together_input import in_step, limits_of_each, require_bodies, require_supported
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.namespace import in_float64
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput
from qtraj.path.route import Route


@of_one_device
def retime_together(
    paths: Sequence[Route],
    limits: Limits | Sequence[Limits],
    start_speed: ArrayInput | None = None,
    end_speed: ArrayInput | None = None,
    knots: int | None = None,
    *,
    tolerance: float = 1e-3,
    duration: float | None = None,
    periodic: bool = False,
    throw: bool = False,
) -> tuple[Retimed, ...]:
    """Compute the fastest timing that several bodies share, within the limits of each; no shape changes.

    The bodies stay in step: at each time, all are at the same parameter u of their routes. Examples are the arms of a
    machine, a formation, or the circles that cover a truck. All routes need joints with the same parameters; splines
    through points at the same parameters have them (`Route.from_piecewise`). A body may be at rest on segments, and
    stop at joints, while another one moves. Only at the start and at the end, all of them may be at rest.

    The problem, the choice of the cells and the proofs are those of `retime`: u̇²(u) is one cubic spline, on which the
    constraints of all bodies are imposed. `gap` is an estimate, or infinite with `knots`. The estimate and the duration
    refer to all bodies.

    Args:
        paths: Routes with the same joints, one for each body, without an uneven progress (see `fit_route`).
        limits: The limits of each body, or of all. They may have all limits of `retime` that are constant numbers,
            except those of vehicles: `speed`, `acceleration`, `lateral_acceleration`, `longitudinal_acceleration`,
            `vertical_speed`, `vertical_acceleration`, `jerk`, `yaw_rate`, `yaw_acceleration`, `curvature_rate` and
            `angular_rate`, in SI units.
        start_speed: The speed of the first body at the start [m/s], 0 for rest of all bodies, or None for any speed.
        end_speed: The same at the end.
        knots: The number of cells, a power of two from 16 to 16384; by default, the cells are chosen. For traced
            arguments, 512 is the default.
        tolerance: The largest estimated relative distance of the duration from the minimum.
        duration: The duration [s], not shorter than the minimum; by default, the minimum. All bodies then accelerate as
            gently as possible: their limits on accelerations are multiplied by `share` of the results, as in `retime`.
        periodic: Whether each end is its start, and the timing is repeated (a flying lap).
        throw: Whether a failure raises a RuntimeError.

    Returns:
        A `Retimed` for each body, in the order of `paths`. All have the same timing, `duration`, `gap` and search; each
        has its own `path`, `certificate`, `usage` and `speeds`. `duration` and `path` are differentiable with respect
        to the limits and the states of the joints, as those of `retime`.

    Raises:
        ValueError: For fewer than two paths, routes with different joints, a route that is always at rest or whose
            velocity is zero within a segment, bodies that are all at rest between the ends, unsupported limits, and
            other arguments that `retime` refuses.
        TypeError: For paths that are not routes.
        RuntimeError: With `throw` if the search fails.

    Example:
        >>> u = [0.0, 1.0, 2.0]
        >>> first = qt.Route(u, [[0, 0, 0], [2, 0, 0], [4, 0, 0]], np.tile([2.0, 0, 0], (3, 1)), np.zeros((3, 3)))
        >>> second = qt.Route(u, [[0, 1, 0], [3, 1, 0], [6, 1, 0]], np.tile([3.0, 0, 0], (3, 1)), np.zeros((3, 3)))
        >>> timed = qt.retime_together([first, second], qt.Limits(speed=1.5))
        >>> [round(float(x.duration), 2) for x in timed]
        [4.0, 4.0]
    """
    require_bodies(paths)
    given = limits_of_each(limits, len(paths))
    for path, own in zip(paths, given, strict=True):
        require_one_path(path, own)
        require_known_along(path, own, (start_speed, end_speed))
    (*bodies,), (*each,) = in_float64(
        (tuple(paths), tuple(own.on(path) for path, own in zip(paths, given, strict=True)))
    )
    names = [require_supported(own, start_speed is None and end_speed is None) for own in each]
    for path in bodies:
        require_float64(path)
        if periodic:
            require_lap(path, start_speed, end_speed)
    require_tolerance(tolerance)
    part = in_step(bodies, names, periodic)
    speeds = tuple(speed_at(v, side) for v, side in ((start_speed, "start"), (end_speed, "end")))
    bounds = [{name: own.given()[name] for name in rows} for own, rows in zip(each, names, strict=True)]
    if not is_traced(bodies, bounds, speeds):
        bounds = [{name: np.asarray(x) for name, x in own.items()} for own in bounds]
    knots = None if knots is None else require_knots(knots)
    others = tuple(zip(bodies[1:], bounds[1:], strict=True))
    posed = Posed(bodies[0], None, bounds[0], None, names[0], bool(periodic), knots, tolerance, others=others)
    require_duration(duration := seconds(duration), is_traced(bodies, bounds, speeds))
    timed = _timed(posed, part, (bodies, each), speeds, duration)
    for own in timed if throw else ():
        own.check()
    return timed


def _timed(
    p: Posed,
    part: Part,
    of_bodies: tuple[list[Route], list[Limits]],
    speeds: tuple[Any, ...],
    duration: float | None,
) -> tuple[Retimed, ...]:
    """Return the results of all bodies, from their routes and limits."""
    bodies, _ = of_bodies
    traced, standing = is_traced(p.path, p.others, p.bounds, speeds), np.array(part.stops)
    xp: Any = jnp if traced else np
    wanted: Any = tuple(np.asarray(np.inf) if v is None else v for v in speeds)
    begins = [begun(path, wanted, standing) for path in bodies]
    rest = (known_zero(speeds[0]) and not standing[0], known_zero(speeds[1]) and not standing[1])
    at_ends = begins[0].largest[(True, True)]
    grid = fixed(p, part) if p.knots is not None or traced else None

    def found(p: Posed) -> tuple[Searched, Any]:
        if grid is not None:
            return searched(p, part, grid, at_ends, rest), np.nan if traced else np.inf
        return on_chosen_cells(p, part, at_ends, rest)

    def time_of(p: Posed) -> float:
        def solved(p: Posed) -> Solved:
            x, _ = found(p)
            return Solved(float(x.times().sum()), x.powers, x.found.error < x.enough)

        return with_ends(p, part, (at_ends, rest), grid, solved)

    def solved(p: Posed) -> Solved:
        x, excess = found(p)
        proved = _proved(x, of_bodies, p.slower, traced)
        return Solved((x, excess, *proved), proved[0].coefficients, x.found.error < x.enough)

    given, share = p, np.nan
    if duration is not None:
        given, share = gentlest(p, duration, any(v is not None and float(v) > 0 for v in speeds), time_of)
    x, excess, timing, certificates, slower = with_ends(given, part, (at_ends, rest), grid, solved)
    time = timing.duration if xp is np else stop_gradient(timing.duration) + x.found.sensitivity
    gap = np.asarray(excess) / time + 1 - (1 - slower) ** 0.5 if duration is None else np.asarray(np.nan)
    usage = [row * (1 - MARGIN) * (1 - slower) ** POWERS[name] for row, name in zip(x.found.usage, p.rows, strict=True)]
    squares = xp.stack([timing.coefficients[0, 0], xp.sum(timing.coefficients[-1])])
    squares = xp.where(np.array(rest), 0.0, squares)
    rates = xp.where(squares > 0, xp.sqrt(xp.where(squares > 0, squares, 1.0)), 0.0)
    goal = xp.where(begins[0].wanted > 0, np.inf, begins[0].wanted)  # a speed at an end is that of the first body
    converged, results = (x.found.error < x.enough, [x.found]), []
    for k, (path, own, begin) in enumerate(zip(bodies, certificates, begins, strict=True)):
        ends = rates * begin.pace, begin.wanted if k == 0 else goal
        code = result_code(xp, own.code, converged, ends, (timing.coefficients, time))
        if not traced and code == ResultCode.successful:
            code = accuracy_code(float(time), duration, np.nan if grid is not None else float(gap), p.tolerance)
        rows = xp.stack([usage[row] for row in rows_of_body(p.all_bounds, k, own.names)])
        rows = rows if duration is None else rows * ratios(own.names, p.all_bounds[k], share)[:, None]
        result = RetimedPath(path, timing), time, own, rows, ends[0], code, x.found.steps
        results.append(Retimed(*result, gap=gap, share=share, wanted=known_speeds(speeds if k == 0 else (None, None))))
    return tuple(results)


def _proved(
    x: Searched, of_bodies: tuple[list[Route], list[Limits]], reduced: float, traced: bool
) -> tuple[Timing, list[Certificate], float]:
    """Return the timing with the certificates of all bodies, and the fraction by which u̇² is reduced.

    `reduced` is the fraction for a prescribed duration. In sharp bends, rounding errors may exceed the margin of the
    search; then the timing is slowed down until the limits are proved. The bodies that failed are certified first.
    """
    bodies = list(zip(*of_bodies, strict=True))

    def timing(slower: float) -> Timing:
        return Timing((1 - slower) * x.found.powers, x.knots, x.rest)

    whole = timing(reduced)
    first = whole, [certify(RetimedPath(path, whole), own) for path, own in bodies], reduced
    if traced or not float(np.max(x.found.usage)) <= 1 + SLOWER[-1]:  # a larger violation remains
        return first
    failed = {k for k, certificate in enumerate(first[1]) if not certificate.holds}
    for more in SLOWER if failed else ():
        slower, found = 1 - (1 - reduced) * (1 - more), dict[int, Certificate]()
        for k in sorted(range(len(bodies)), key=lambda k: k not in failed):
            found[k] = certify(RetimedPath(bodies[k][0], timing(slower)), bodies[k][1])
            if not found[k].holds:
                failed.add(k)
                break
        else:
            return timing(slower), [found[k] for k in range(len(bodies))], slower
    return first
