"""Create random routes: winding drives, drives with a stop, and fits of recordings."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import qtraj as qt

from .group import Fields, car

DATA = Path(__file__).parents[2] / "tests" / "data"
BENDS = DATA / "boreas_bends.csv"
JOINTS = 9
ORDERS = ("position", "velocity", "acceleration")


def winding(rng: np.random.Generator, count: int, noise: float = 0.01) -> Fields:
    """Return the joints of winding drives over hills, at changing speeds of about 4 to 8 m/s, with random errors."""
    times = np.pad(np.cumsum(rng.uniform(0.8, 1.2, (count, JOINTS - 1)), axis=1), [(0, 0), (1, 0)])
    t = times + rng.uniform(0, 10, (count, 1))
    a, w = rng.uniform(2, 5, (count, 1)), rng.uniform(0.35, 0.55, (count, 1))
    speed, z = rng.uniform(5, 7, (count, 1)), 0 * t
    rows = [
        [speed * t + 2 * np.sin(0.3 * t), a * np.sin(w * t), 0.5 * np.cos(0.2 * t)],
        [speed + 0.6 * np.cos(0.3 * t), a * w * np.cos(w * t), -0.1 * np.sin(0.2 * t)],
        [z - 0.18 * np.sin(0.3 * t), -a * w**2 * np.sin(w * t), -0.02 * np.cos(0.2 * t)],
    ]
    noisy = (np.stack(row, axis=-1) + rng.normal(0, noise, (count, JOINTS, 3)) for row in rows)
    return {"times": times, **dict(zip(ORDERS, noisy, strict=True))}


def stopping(rng: np.random.Generator, count: int, reverses: bool = False) -> Fields:
    """Return the joints of winding drives that wait between joints 4 and 5; with `reverses`, they then go back."""
    given = winding(rng, count)
    position, velocity, acceleration = (given[name] for name in ORDERS)
    velocity[:, 4:6] = acceleration[:, 4:6] = 0.0
    position[:, 4] -= 0.4 * (position[:, 4] - position[:, 3])
    position[:, 5:] += position[:, 4:5] - position[:, 5:6]
    position[:, 6:] -= 0.4 * (position[:, 6:7] - position[:, 5:6])
    if reverses:
        position[:, 6:] = 2 * position[:, 5:6] - position[:, 6:]
        velocity[:, 6:], acceleration[:, 6:] = -velocity[:, 6:], -acceleration[:, 6:]
    return given


def fitted(rng: np.random.Generator, count: int) -> Fields:
    """Return the joints of routes that are fitted to windows of eight seconds of a recording."""
    track = qt.read_track(BENDS)
    first, last = float(np.asarray(track.times)[0]), float(np.asarray(track.times)[-1])
    rows = []
    for begin in rng.uniform(first, last - 8.2, count):
        window = track.window(float(begin), float(begin) + 8.1)
        elapsed = np.asarray(window.times) - np.asarray(window.times)[0]
        route = qt.fit_route(window, knots=np.linspace(0.0, elapsed[-1], JOINTS)).path
        rows.append((np.asarray(route.times), *np.moveaxis(np.asarray(route.joints()), 1, 0)))
    return dict(zip(("times", *ORDERS), (np.stack(x) for x in zip(*rows, strict=True)), strict=True))


def route(given: Fields, k: int) -> qt.Route:
    """Return problem k as a route: quintics through the states, or a cubic spline if only positions are given."""
    if "velocity" not in given:
        return qt.Route.from_piecewise(CubicSpline(given["times"][k], given["position"][k]))
    return qt.Route(given["times"][k], *(given[name][k] for name in ORDERS))


def splines(rng: np.random.Generator, count: int) -> Fields:
    """Return times and positions of winding drives, which cubic splines interpolate."""
    given = winding(rng, count)
    return {name: given[name] for name in ("times", "position")}


def one(names: tuple[str, ...], given: Fields, k: int) -> qt.Limits:
    """Return the limits of problem k."""
    vehicle: Any = car(given["vehicle"][k]) if "vehicle" in given else None
    return qt.Limits(**dict(zip(names, given["limits"][k].tolist(), strict=True)), vehicle=vehicle)
