"""World axes of a recording, and their conversion to axes whose third axis is up."""

from collections.abc import Mapping

import numpy as np

from qtraj.algebra import hamilton
from qtraj.io.track.column_names import is_one_of
from qtraj.io.track.known_names import ENU_POSITION, ENU_VELOCITY, NED_POSITION, NED_VELOCITY

AXES = ("enu", "ned", "camera")
MEANING = {
    "enu": "x, y, z with z up",
    "ned": "north, east, down",
    "camera": "right, down, forward",
    "geographic": "latitude, longitude, height",
}
_WORLD = {
    "ned": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "camera": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
"""Rotations from the recorded world axes to x, y, z with z up."""

_BODY = {
    "ned": np.diag([1.0, -1.0, -1.0]),
    "camera": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
}
"""Rotations from the recorded body axes to forward, left, up."""

_HALF = np.sqrt(0.5)
_WORLD_QUATERNION = {"ned": (0.0, _HALF, _HALF, 0.0), "camera": (_HALF, -_HALF, 0.0, 0.0)}
_BODY_QUATERNION = {"ned": (0.0, 1.0, 0.0, 0.0), "camera": (0.5, 0.5, -0.5, 0.5)}
"""The same rotations as quaternions, scalar first; `_BODY_QUATERNION` from forward, left, up to the recorded axes."""

NAMED = {"position": (ENU_POSITION, NED_POSITION), "velocity": (ENU_VELOCITY, NED_VELOCITY)}


def choose_axes(chosen: Mapping[str, tuple[str, ...]], axes: str | None, globe: bool) -> dict[str, str]:
    """Return the axes of each quantity: by its column names if they name directions, otherwise `axes`.

    Without `axes`, quantities whose names do not tell have z up; an attitude and its rates refer to north, east, down
    if the position or the velocity does.

    **Raises:** ValueError for unknown axes, for axes that differ from the names, and if only one of position and
    velocity has the names of north, east, down.
    """
    if axes is not None and axes not in AXES:
        raise ValueError(f"axes= must be {', '.join(map(repr, AXES[:-1]))} or {AXES[-1]!r}, but {axes!r} was given")
    named = {part: name for part, names in chosen.items() if (name := _named(part, names)) is not None}
    if globe:
        named["position"] = "geographic"
    for part, name in named.items():
        if axes is not None and name not in (axes, "geographic"):
            raise ValueError(
                f"the columns {', '.join(chosen[part])} are {name!r} by their names, but axes={axes!r} was given: "
                "omit axes=, or name the columns by columns="
            )
    down = "ned" in named.values()
    unknown = [part for part in ("position", "velocity") if part in chosen and part not in named]
    if axes is None and down and unknown:
        other = next(part for part, name in named.items() if name == "ned")
        raise ValueError(
            f"the {other} is north, east, down by its columns {', '.join(chosen[other])}, but the columns "
            f"{', '.join(chosen[unknown[0]])} of the {unknown[0]} do not name their axes: pass axes='ned' if they are "
            f'north, east, down too, or omit the velocity by columns={{"velocity": None}}'
        )
    default = axes or ("ned" if down else "enu")
    return {part: named.get(part, default) for part in chosen}


def _named(part: str, names: tuple[str, ...]) -> str | None:
    for name, forms in zip(("enu", "ned"), NAMED.get(part, ()), strict=False):
        if is_one_of(forms, names):
            return name
    return None


def vectors_up(vectors: np.ndarray, axes: str) -> np.ndarray:
    """Return world vectors (n, 3) in axes with z up."""
    return vectors @ _WORLD[axes].T if axes in _WORLD else vectors


def attitudes_up(attitudes: np.ndarray, axes: str) -> np.ndarray:
    """Return quaternions (n, 4), scalar first, from body axes forward, left, up to world axes with z up.

    With `axes` "ned" the recorded body axes are forward, right, down; with "camera" they are right, down, forward.
    """
    if axes not in _WORLD:
        return attitudes
    q = tuple(attitudes.T)
    world, body = (
        tuple(np.full(len(attitudes), x) for x in table[axes]) for table in (_WORLD_QUATERNION, _BODY_QUATERNION)
    )
    return np.stack(hamilton.product(hamilton.product(world, q), body), axis=1)  # pyright: ignore[reportArgumentType]


def rates_up(rates: np.ndarray, axes: str) -> np.ndarray:
    """Return angular rates (n, 3) in the body axes forward, left, up, or the yaw rate (n, 1) positive to the left."""
    if axes not in _BODY:
        return rates
    return -rates if rates.shape[1] == 1 else rates @ _BODY[axes].T
