"""Maxima of one constraint over time: candidates on a grid of instants, and their refinement."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.searches import Curves, Samples
from qtraj.path.quantity import quantity

NODES = 65
GRID = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, NODES))
"""The Chebyshev nodes: grid instants that are denser near both ends."""

PER_LIMIT = 8
"""Number of local maxima of each limit that are refined, starting with the highest."""

SHOULDER = 0.25
"""A node is a candidate for a peak, too, if the higher one of its neighbours exceeds it by this part of its own excess
over the lower one: two peaks may be closer to each other than the nodes."""

RELEVANT = -1.5
"""Maxima below this constraint value are not refined: a quantity at a fifth of its limit constrains no step."""

RELEVANT_CLEARANCE = -12.0
"""The same for an obstacle, whose constraint value is quadratic: a ball at five times the sum of the radii."""

SHARP = 0.05
"""If the smallest value of a divisor is below this fraction of its largest, a peak near its minimum may be narrow."""

OFFSETS = np.linspace(-1.0, 1.0, 9)[:, None]
NARROW = np.concatenate([-(0.25 ** np.arange(9.0)), [0.0], 0.25 ** np.arange(8.0, -1.0, -1.0)])[:, None]
"""Instants about a node and about the minimum of a divisor, in units of the distance between nodes."""

NEWTON, NEGLIGIBLE = 8, 1e-9
"""Newton's method for the time of a peak ends when the value increases by less than the second number, where its error
is far below rounding error, or after the first number of steps."""


@dataclass
class Candidates:
    """Peaks before their refinement: the search of each, and an interval that contains the maximum."""

    owner: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def highest(
    g: Float[np.ndarray, "nodes batch"], nodes: Float[np.ndarray, "nodes *batch"], least: float = RELEVANT
) -> Candidates:
    """Return the highest local maxima of each search at the nodes, at least `least`, and the shoulders beside them."""
    rise, drop = np.zeros(g.shape), np.zeros(g.shape)
    rise[1:] = g[1:] - g[:-1]
    drop[:-1] = -rise[1:]
    is_peak = (rise >= -SHOULDER * drop) & (drop >= -SHOULDER * rise)
    heights = np.where(is_peak & (g > least), g, -np.inf)
    if np.max(np.count_nonzero(heights > -np.inf, axis=0), initial=0) > PER_LIMIT:
        lowest = np.partition(heights, -PER_LIMIT, axis=0)[-PER_LIMIT]
        heights = np.where(heights >= lowest, heights, -np.inf)
    node, owner = np.nonzero(heights > -np.inf)
    times = np.broadcast_to(nodes.reshape(NODES, -1), g.shape)
    low, high = np.maximum(node - 1, 0), np.minimum(node + 1, NODES - 1)
    return Candidates(owner, times[low, owner], times[node, owner], times[high, owner])


def sharp(name: str, curves: Curves, nodes: Samples, count: int) -> Candidates:
    """Return candidates near the minimum of the quantity's divisor, if this minimum, at the grid nodes, is small."""
    none = np.zeros(0)
    divisor = quantity(name).divisor
    if divisor is None:
        return Candidates(np.zeros(0, int), none, none, none)
    values = np.broadcast_to(nodes.divisor(divisor), (NODES, count))
    owner = np.flatnonzero(values.min(axis=0) < SHARP * values.max(axis=0))
    node = values[:, owner].argmin(axis=0)
    low, middle, high = GRID[np.maximum(node - 1, 0)], GRID[node], GRID[np.minimum(node + 1, NODES - 1)]
    own, order = curves.at(owner), quantity(name).order
    for _ in range(3 if owner.size else 0):
        u = instants(low, middle, high, OFFSETS)
        depth = -np.log(np.maximum(own.samples(u, order).divisor(divisor), 1e-300))
        low, middle, high = parabola(u, depth, depth.argmax(axis=0))
    return Candidates(owner, np.maximum(middle - 0.02, 0.0), middle, np.minimum(middle + 0.02, 1.0))


def instants(low: np.ndarray, middle: np.ndarray, high: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return instants about `middle`; the offsets −1 and 1 are `low` and `high`."""
    return middle + np.where(offsets < 0, middle - low, high - middle) * offsets


def _top(g: np.ndarray) -> np.ndarray:
    """Return the indices of the highest local maxima inside, or else of the highest values."""
    inside = (g[1:-1] >= g[:-2]) & (g[1:-1] >= g[2:])
    best = 1 + np.where(inside, g[1:-1], -np.inf).argmax(axis=0)
    return np.where(inside.any(axis=0), best, g.argmax(axis=0))


def parabola(u: np.ndarray, g: np.ndarray, best: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times about the value of index `best`, and between them the top of the parabola through these."""
    last = len(u) - 1
    points = np.arange(best.size)
    index = np.clip(best, 1, last - 1)
    (a, x), (b, y), (c, z) = ((u[index + k, points], g[index + k, points]) for k in (-1, 0, 1))
    with np.errstate(all="ignore"):
        left, right = (y - x) / (b - a), (z - y) / (c - b)
        top = 0.5 * (a + b) - left * (c - a) / (2 * (right - left))  # zero of the interpolated slope
    low, high = u[np.maximum(best - 1, 0), points], u[np.minimum(best + 1, last), points]
    middle = u[best, points]
    good = np.isfinite(top) & (top >= low) & (top <= high) & (right < left)
    return low, np.where(good, top, middle), high


def refined(
    name: str, curves: Curves, at: Candidates, offsets: np.ndarray, rounds: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the values of the maxima, by Newton's method after `rounds` parabolas."""
    order = quantity(name).order

    def sampled(low: np.ndarray, middle: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = instants(low, middle, high, offsets)
        return u, np.broadcast_to(curves.values([name], u, order)[0], u.shape)

    u, g = sampled(at.low, at.middle, at.high)
    for _ in range(rounds - 1):
        u, g = sampled(*parabola(u, g, _top(g)))
    points = np.arange(u.shape[1])
    best = _top(g)
    time, value = u[best, points], g[best, points]
    low, trial, high = parabola(u, g, best)
    top, height, rest = np.array(trial), np.array(value), points
    for _ in range(NEWTON):
        there, rate, second = curves.along_u(name, trial, order)
        bend = np.where(second < 0, second, -np.inf)
        exact = np.clip(trial - rate / bend, low, high)
        # The value at the next point of Newton's method, to third order.
        gain = (rate + 0.5 * np.where(second < 0, second, 0.0) * (exact - trial)) * (exact - trial)
        top[rest], height[rest] = exact, there + gain
        on = np.flatnonzero(gain > NEGLIGIBLE)
        if on.size == 0:
            break
        rest, low, high, trial, curves = rest[on], low[on], high[on], exact[on], curves.at(on)
    better = height >= value
    return np.where(better, top, time), np.where(better, height, value)
