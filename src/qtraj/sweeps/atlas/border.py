"""The border of a class as polylines: the middles of the sides whose ends differ, joined inside the leaves."""

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from qtraj.sweeps.atlas.quadtree import Leaf, Point, boundary

Side = tuple[Point, Point]


def border_lines(leaves: Iterable[Leaf], inside: dict[Point, int]) -> list[Float[np.ndarray, "n 2"]]:
    """Return the border between points that are `inside` (1) and the others (0), in units of the lattice.

    Where a border crosses itself between four corners, the points outside are joined. A closed line ends at its first
    point.
    """
    joined: dict[Side, list[Side]] = defaultdict(list)
    for leaf in leaves:
        for a, b in _segments(boundary(leaf, inside), inside):
            joined[a].append(b)
            joined[b].append(a)
    return [np.array([_middle(side) for side in line]) for line in _lines(joined)]


def _segments(around: list[Point], inside: dict[Point, int]) -> list[tuple[Side, Side]]:
    """Return the pairs of sides between which the border crosses a leaf: around each run of points inside."""
    sides = [(around[k - 1], point) for k, point in enumerate(around) if inside[around[k - 1]] != inside[point]]
    first = next((k for k, (_, point) in enumerate(sides) if inside[point]), 0)
    ordered = [_sorted(side) for side in sides[first:] + sides[:first]]
    return list(zip(ordered[::2], ordered[1::2], strict=True))


def _sorted(side: Side) -> Side:
    return (min(side), max(side))


def _middle(side: Side) -> tuple[float, float]:
    (a, b), (c, d) = side
    return (a + c) / 2, (b + d) / 2


def _lines(joined: dict[Side, list[Side]]) -> list[list[Side]]:
    """Return the chains of joined sides: first those with ends, then closed ones."""
    lines, seen = [], set()
    for start in sorted(joined, key=lambda side: (len(joined[side]), side)):
        if start in seen:
            continue
        line = [start]
        seen.add(start)
        while onward := [side for side in joined[line[-1]] if side not in seen]:
            line.append(onward[0])
            seen.add(onward[0])
        if len(line) > 2 and start in joined[line[-1]]:
            line.append(start)
        lines.append(line)
    return lines
