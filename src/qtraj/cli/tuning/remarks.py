"""What else there is to say of a tuning: what was held and bounded, and whether the path went far off."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.cli.tuning.job import Job

FAR = 3.0
"""A path so many times as long, in metres or in seconds, as the one before was hardly meant."""


def held(job: Job) -> dict[str, Any]:
    """The variables that kept their given value, and the lowest and highest value of others, None for none."""
    return {"fixed": list(job.fixed), "bounds": {name: list(bounds) for name, bounds in job.bounds.items()}}


def fixed_text(tuning: Mapping[str, Any]) -> str:
    """The names of the variables that kept their given value; empty for none."""
    return ", ".join(tuning["fixed"])


def bounds_text(tuning: Mapping[str, Any]) -> str:
    """What was bounded, and how, in words; empty for nothing."""
    return ", ".join(_span(name, *bounds) for name, bounds in tuning["bounds"].items())


def _span(name: str, low: float | None, high: float | None) -> str:
    unit = "s" if name == "duration" else "m/s"
    if low is not None and high is not None:
        return f"{name} from {low:.6g} to {high:.6g} {unit}"
    return f"{name} at least {low:.6g} {unit}" if low is not None else f"{name} at most {high:.6g} {unit}"


def moved(before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    """What the tuned path changes: heading at both ends [rad, left positive], lowest and highest point [m].

    Both are rows of position and velocity along a path, (2, n, 3). The heading's change is None where there is none.
    """

    def turned(k: int) -> float | None:
        (x, y), (u, v) = before[1, k, :2], after[1, k, :2]
        return math.atan2(x * v - y * u, x * u + y * v) if np.hypot(x, y) * np.hypot(u, v) > 0 else None

    heights = [path[0, :, 2] for path in (before, after)]
    return {
        "heading": {"start": turned(0), "end": turned(-1)},
        "lowest": float(np.min(heights[1]) - np.min(heights[0])),
        "highest": float(np.max(heights[1]) - np.max(heights[0])),
    }


def moved_text(change: Mapping[str, Any]) -> str:
    """The same in words."""
    start, end = (_sideways(change["heading"][name]) for name in ("start", "end"))
    low, high = (round(change[name], 2) + 0.0 for name in ("lowest", "highest"))
    return (
        f"Its heading turns {start} at A and {end} at B; its lowest point moves by {low:+.2f} m, its highest by "
        f"{high:+.2f} m."
    )


def _sideways(turn: float | None) -> str:
    if turn is None:
        return "by an angle that does not exist"
    degrees = round(math.degrees(turn), 1)
    return "by 0.0°" if degrees == 0 else f"{abs(degrees):.1f}° to the {'left' if degrees > 0 else 'right'}"


def far_off(content: Mapping[str, Any], before: np.ndarray) -> str | None:
    """What to say where the tuned path is far longer or slower than the one before, or leaves it by more than its size.

    `before` are positions (n, 3) along the path before, whose size is the diagonal of the box about them.
    """
    was, now = content["boundary"]["before"], content["boundary"]["after"]
    size = float(np.linalg.norm(np.ptp(before, axis=0)))
    longer, slower = (now[name] / was[name] for name in ("length", "duration"))
    found = []
    if longer > FAR:
        found.append(f"is {longer:.3g} times as long ({_change(now, was, 'length', 'm')})")
    if slower > FAR:
        found.append(f"takes {slower:.3g} times the time ({_change(now, was, 'duration', 's')})")
    if content["departure"] > size:
        found.append(f"leaves it by {content['departure']:.3g} m, more than its own size of {size:.3g} m")
    if not found:
        return None
    listed = " and ".join(filter(None, [", ".join(found[:-1]), found[-1]]))
    return (
        f"Mind: against the path before, the tuned one {listed}. A limit may be smaller than meant, or in another "
        "unit; [tune.bounds] keeps a path near."
    )


def _change(now: Mapping[str, float], was: Mapping[str, float], name: str, unit: str) -> str:
    return f"{now[name]:.4g} {unit}, before {was[name]:.4g} {unit}"
