"""Check the arguments of `retime_together`, and find what the bodies have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from qtraj.design.by_speed import BySpeed
from qtraj.design.limits import Limits, require_limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.timing.bodies import SUPPORTED
from qtraj.design.timing.parts import Part, known_segments, of_path, standing_ends
from qtraj.design.timing.requirements import require_timing_limits
from qtraj.path.route import Route


def require_bodies(paths: Any) -> None:
    """Raise an error if the argument `paths` is not a sequence of at least two routes without an uneven progress."""
    if isinstance(paths, Route) or not isinstance(paths, Sequence) or len(paths) < 2:
        raise ValueError(
            f"retime_together expects a list of at least two routes, but {paths!r} was given: for one path, use retime"
        )
    for k, path in enumerate(paths):
        if not isinstance(path, Route):
            raise TypeError(
                f"retime_together expects routes, because all bodies need the same parameter, but path {k} is a "
                f"{type(path).__name__}: build a route with qtraj.Route or qtraj.Route.from_piecewise"
            )
        if path.progress is not None:
            raise ValueError(
                f"the parameter of route {k} is uneven where the recorded vehicle creeps, so that it has no common "
                "parameter with other routes: pass routes without it, such as those of qtraj.Route.from_piecewise"
            )


def limits_of_each(limits: Any, count: int) -> list[Limits]:
    """Return the limits of each body; raise an error for another number of limits."""
    given = [limits] * count if isinstance(limits, Limits) else limits
    if not isinstance(given, Sequence):
        require_limits(limits)
    for own in given:
        require_limits(own)
    if len(given) != count:
        raise ValueError(f"{count} paths need as many limits, or one Limits for all, but {len(given)} were given")
    return list(given)


def require_supported(limits: Limits, free: bool) -> tuple[str, ...]:
    """Return the names of the limits of one body, or raise an error if several bodies cannot have them."""
    refuse_obstacles(limits, "retime_together", "check the paths of the results with qtraj.certify")
    names = require_timing_limits(limits, free)
    other = [name for name, x in limits.given().items() if name not in SUPPORTED or isinstance(x, BySpeed)]
    if other := list(dict.fromkeys([*limits.varying, *other])):
        raise ValueError(
            f"retime_together supports only constant limits without a vehicle, but {', '.join(other)} was given: "
            "remove it, and check it with qtraj.certify on the path of each result"
        )
    return tuple(name for name in SUPPORTED if name in names)


def in_step(paths: list[Route], names: list[tuple[str, ...]], lap: bool) -> Part:
    """Return the whole of routes with the same joints as one part of a path; its stops are those of all bodies.

    **Raises:** ValueError for routes with different joints, for bodies that are all at rest at a joint between the
    ends, and for each route as `retime` does.
    """
    segments = [known_segments(path) for path in paths]
    first = segments[0]
    for k, own in enumerate(segments[1:], 1):
        if own.starts.shape != first.starts.shape or not (
            np.array_equal(own.starts, first.starts) and np.array_equal(own.durations, first.durations)
        ):
            raise ValueError(
                f"the joints of route {k} have other parameters than those of route 0, but the bodies have one common "
                "parameter: build all routes on the same times, such as splines through points at the same times"
            )
    parts = [of_path(path, own)[0] for path, own in zip(paths, names, strict=True)]
    still = [~np.asarray(own.coefficients[:, 1:].any(axis=(1, 2))) for own in segments]
    slow = np.array([standing_ends(own) | x[:, None] for own, x in zip(segments, still, strict=True)])
    rest: np.ndarray = np.logical_and.reduce(slow)
    common = np.flatnonzero(rest[:-1, 1] | rest[1:, 0])
    if common.size or rest.all(axis=1).any():
        at = first.starts[1:][common[:1]] if common.size else first.starts[:1]
        raise ValueError(
            f"all bodies are at rest at {float(at[0]):.6g} s, but they may be so only at the start and at the end: "
            "time the motions before and after separately, with windows of the routes"
        )
    stops = bool(rest[0, 0]), bool(rest[-1, 1])
    if lap and any(stops):
        raise ValueError("a flying lap has no stops, but all bodies are at rest at its start: pass periodic=False")
    smooth = np.min([_smoothness(own, first.starts.size) for own in parts], axis=0)
    if any("jerk" in own for own in names):  # the acceleration of another body must not jump
        smooth = np.maximum(smooth, 1)
    end = first.starts[-1] + first.durations[-1]
    return Part(first.starts[0], end, 0, first.starts.size, True, stops, smooth)


def _smoothness(parts: list[Part], segments: int) -> np.ndarray:
    """Return the order of the derivatives of u̇² that one body needs to be continuous at all joints.

    Where it stops, the second derivative may jump, so that the limits are imposed on both sides of the joint.
    """
    smooth = np.ones(segments - 1, int)
    for part in parts:
        smooth[part.first : part.last - 1] = part.smooth
    return smooth
