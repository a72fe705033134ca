"""Compute the margins of limits at nodes, which account for larger values between the nodes."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.constraints import Names, values
from qtraj.design.tuning_route.problem import RouteProblem, Segments, by_blocks, segments

LEAST_MARGIN = 0.5

FULL = 0.625
"""A node accounts fully for maxima within this fraction of a cell."""

FAR, CLOSE = 0.8, 0.9
"""A margin is 1 if the squared quantity is below the first fraction of the squared limit, and has its full effect if
the squared quantity is above the second fraction."""


def refreshed(names: Names, problem: RouteProblem, z: Float[Array, "10 joints"], margins: Any) -> Any:
    """Return margins with which the constraint at each node also bounds the maxima in the adjacent half cells.

    A margin is the ratio of the value at the node to the maximum, at the current variables. Parabolas through the
    values on a finer grid give the maxima. No margin is needed where the values between two nodes do not exceed the
    larger of the two values at the nodes.
    """

    def local(problem: RouteProblem, s: Segments) -> tuple[Array, Array]:
        fine = values(names, problem, s, fine=True)
        own = fine[:, :: basis.FINER]
        return own, own + _above(own, fine)

    own, largest = by_blocks(local, problem, segments(problem, z), fine=True)
    largest = _joined(largest, problem.used, problem.seam)
    safe = largest > 1e-3
    ratio = jnp.where(safe, own / jnp.where(safe, largest, 1.0), 1.0)
    # The ratio matters only where the limit is nearly reached; elsewhere it would restrict the search needlessly.
    weight = jnp.clip((largest / margins.max() - FAR) / (CLOSE - FAR), 0.0, 1.0)
    return 1.0 - weight * (1.0 - jnp.maximum(ratio, LEAST_MARGIN))


def _above(own: Array, fine: Array) -> Array:
    """Return by how much the maxima near each node exceed the value at the node.

    A maximum counts in full up to a little more than half a cell away, and less towards the next node, so that margins
    are continuous functions of the variables. Jumps would prevent their convergence.
    """
    middle, before, after = fine[:, 1:-1], fine[:, :-2], fine[:, 2:]
    bend = before - 2 * middle + after
    divisor = jnp.where(bend < 0, -bend, 1.0)
    place = 0.5 * (after - before) / divisor
    inside = (bend < 0) & (jnp.abs(place) <= 1)
    peak = jnp.where(inside, middle + 0.5 * place**2 * divisor, 0.0)
    reach, wide = basis.FINER, ((0, 0), (basis.FINER + 1, basis.FINER + 1), (0, 0))
    peak, place = jnp.pad(peak, wide), jnp.pad(place, wide)
    above = jnp.zeros_like(own)
    for k in range(-reach, reach + 1):
        nodes = slice(reach + k, reach + k + basis.CELLS * basis.FINER + 1, basis.FINER)
        away = jnp.abs(k + place[:, nodes]) / reach
        weight = jnp.clip((1.0 - away) / (1.0 - FULL), 0.0, 1.0)
        above = jnp.maximum(above, weight * (peak[:, nodes] - own))
    return above


def _joined(largest: Array, used: Array, seam: Array | None) -> Array:
    """Return the largest values near used nodes, including the values near unused neighbours of these nodes.

    The value at the end of a segment is assigned to the start of the next segment, unless the quantity may jump there.
    If a fixed joint has no used node, the value is assigned to the nearest node inside the segment.
    """
    ends = largest[:, -1] * (1 - used[:, -1])
    before = jnp.pad(ends[:, :-1], ((0, 0), (1, 0)))
    after = jnp.pad(used[:, 0, 1:], ((0, 0), (0, 1)))
    if seam is not None:  # the first segment follows the last one
        before = before.at[:, 0].set(ends[:, seam - 1])
        after = after.at[:, seam - 1].set(used[:, 0, 0])
    alone = ends * (1 - after)
    largest = largest.at[:, -2].max(alone).at[:, 1].max(largest[:, 0] * (1 - used[:, 0]))
    return largest.at[:, 0].max(before)
