"""Facts about the torques of a simulated rigid body, as data and as text for the terminal."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.foundation.number_text import degrees, number
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.body_motion import BodyMotion


def body_facts(body: RigidBody, motion: BodyMotion) -> dict[str, Any]:
    """Return the facts as JSON types: the largest values at the instants of `motion`, and the limits.

    `inertia_is_exact`: whether the control computer assumes the exact inertia. `largest_torque` [N m], and the limit of
    thrusters, `torque_limit` [N m]. `largest_mismatch` [rad/s²]: the largest acceleration minus command. With wheels
    also `largest_momenta` and `momentum_limits` [N m s], one of each wheel. Values that are not known are None.
    """
    facts = {
        "inertia_is_exact": bool(np.array_equal(body.inertia, body.assumed)),
        "largest_torque": _largest(np.linalg.norm(motion.torque, axis=1)),
        "torque_limit": None if body.max_torque is None else float(body.max_torque),
        "largest_mismatch": _largest(np.linalg.norm(motion.mismatch, axis=1)),
    }
    if body.wheels is None or motion.momentum is None:
        return facts
    limits = body.wheels.max_momentum
    return facts | {
        "largest_momenta": [_largest(np.abs(momentum)) for momentum in np.asarray(motion.momentum).T],
        "momentum_limits": None if limits is None else np.asarray(limits).tolist(),
    }


def body_fact_rows(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the facts of `body_facts` as pairs of a name and a text; None becomes a dash."""
    law = "exact" if facts["inertia_is_exact"] else "not the inertia of the body"
    limit = "" if facts["torque_limit"] is None else f", limit {number(facts['torque_limit'])} N m"
    rows = [
        ("inertia of the law", law),
        ("largest torque", f"{number(facts['largest_torque'])} N m{limit}"),
        ("largest mismatch", f"{degrees(facts['largest_mismatch'])} °/s², acceleration minus command"),
    ]
    if "largest_momenta" in facts:
        momenta = ", ".join(number(x, 4) for x in facts["largest_momenta"])
        rows.append(("wheel momenta", f"up to {momenta} N m s"))
        if facts["momentum_limits"] is not None:
            rows.append(("limits of momenta", f"{_distinct(facts['momentum_limits'])} N m s"))
    return rows


def _distinct(limits: list[float]) -> str:
    return ", ".join(map(number, limits[:1] if len(set(limits)) == 1 else limits))


def _largest(values: np.ndarray) -> float | None:
    return float(np.nanmax(values)) if np.isfinite(values).any() else None
