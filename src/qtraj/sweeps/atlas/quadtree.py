"""A quadtree on a lattice: squares of cells that are divided where their corners differ.

A leaf (i, j, s) covers the lattice from (i, j) to (i + s, j + s). A leaf is mixed if the known points on its boundary,
which are its corners and the corners of smaller neighbours, have different kinds. So a border that enters a large leaf
between two of its corners is followed if a neighbour has found it.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

Point = tuple[int, int]
Leaf = tuple[int, int, int]

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
"""The corners of a unit square, counterclockwise."""


class Quadtree:
    """The leaves over `shape` coarse cells, each of which can be halved `levels` times, and the kinds of the points."""

    def __init__(self, shape: Point, levels: int):
        size = 2**levels
        self.coarsest = size
        self.kinds: dict[Point, int] = {}
        self.leaves = {(i * size, j * size, size) for i in range(shape[0]) for j in range(shape[1])}
        self._mixed: set[Leaf] = set()
        self._undecided: list[Leaf] = sorted(self.leaves)

    def wanted(self) -> list[Point]:
        """Return the points that must be known for the next step: corners first, then the points that divide leaves."""
        if not self.kinds:
            return sorted({point for leaf in self.leaves for point in corners(leaf)})
        return sorted({point for leaf in self._mixed for point in _dividing(leaf)} - self.kinds.keys())

    def divide(self, kinds: dict[Point, int]) -> None:
        """Divide all mixed leaves at points whose `kinds` are new, and find the leaves that are mixed now."""
        self.kinds |= kinds
        divided, self._mixed = self._mixed, set()
        for leaf in divided:
            self.leaves.discard(leaf)
            self._undecided += _children(leaf)
        self.leaves.update(self._undecided)
        for leaf in self._undecided:
            self._mark(leaf)
        self._undecided = []
        for leaf in divided:
            for neighbour in self._neighbours(leaf):
                self._mark(neighbour)

    @property
    def mixed(self) -> bool:
        """Whether leaves remain to be divided."""
        return bool(self._mixed)

    def _mark(self, leaf: Leaf) -> None:
        if leaf[2] > 1 and len({self.kinds[point] for point in boundary(leaf, self.kinds)}) > 1:
            self._mixed.add(leaf)

    def _neighbours(self, leaf: Leaf) -> Iterator[Leaf]:
        """Yield the leaves that are at least as large as a divided leaf and share one of its sides."""
        i, j, s = leaf
        for x, y in ((i - s, j), (i + s, j), (i, j - s), (i, j + s)):
            size = s
            while size <= self.coarsest:
                found = (x // size * size, y // size * size, size)
                if found in self.leaves:
                    yield found
                    break
                size *= 2


def corners(leaf: Leaf) -> list[Point]:
    """Return the corners of a leaf, counterclockwise."""
    i, j, s = leaf
    return [(i + s * a, j + s * b) for a, b in CORNERS]


def boundary(leaf: Leaf, kinds: dict[Point, int]) -> list[Point]:
    """Return the known points on the boundary of a leaf, counterclockwise from its first corner."""
    four = corners(leaf)
    return [point for k in range(4) for point in _along(four[k], four[(k + 1) % 4], kinds)]


def _along(start: Point, end: Point, kinds: dict[Point, int]) -> list[Point]:
    """Return the known points from `start` to before `end`; a point is known only if the middle of its side is."""
    middle = ((start[0] + end[0]) // 2, (start[1] + end[1]) // 2)
    if abs(start[0] - end[0]) + abs(start[1] - end[1]) == 1 or middle not in kinds:
        return [start]
    return [*_along(start, middle, kinds), *_along(middle, end, kinds)]


def _dividing(leaf: Leaf) -> list[Point]:
    i, j, s = leaf
    h = s // 2
    return [(i + h, j), (i, j + h), (i + h, j + h), (i + s, j + h), (i + h, j + s)]


def _children(leaf: Leaf) -> list[Leaf]:
    i, j, s = leaf
    h = s // 2
    return [(i + h * a, j + h * b, h) for a, b in CORNERS]


def as_arrays(tree: Quadtree) -> tuple[Int[np.ndarray, "n 2"], Int[np.ndarray, "m 3"]]:
    """Return the points in the order in which they became known, and the leaves in order."""
    return np.array([*tree.kinds], np.int64).reshape(-1, 2), np.array(sorted(tree.leaves), np.int64).reshape(-1, 3)
