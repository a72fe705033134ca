"""Bound the distance of a timing on prescribed cells from the minimum duration over all timings."""

from __future__ import annotations

from typing import Any

import numpy as np

from qtraj.design.timing.cells import chosen, finest
from qtraj.design.timing.part_search import Posed, shape_of, task_of
from qtraj.design.timing.parts import Part

ACCURACY = 0.2
"""Accuracy of the cells of the bound, as a fraction of the tolerance."""


def excess_over_bound(p: Posed, part: Part, ends: Any, rest: tuple[bool, bool], time: float) -> float:
    """Return the difference of a duration `time` to a lower bound on the duration of a part [s].

    The bound is that of the relaxed timing, on cells of its own: it is close without limits that couple speed and
    acceleration. The result is infinite if the limits do not bound the acceleration.
    """
    shape = shape_of(p.path, part, [path for path, _ in p.others])
    task = task_of(p, ends, part, rest, shape)
    least = finest(shape, task, chosen(shape, task, ACCURACY * p.tolerance)[0])
    return float(np.maximum(time - least, 0.0))
