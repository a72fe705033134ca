"""Determine the result code of a timing from its searches, its certificate and its speeds."""

from typing import Any

import numpy as np

from qtraj.design.timing.search import Found
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import Scalar

REACHED = 2e-3
"""An end speed counts as reached if it is lower than required by at most this fraction; if rounding errors exceed the
margin of the proofs, the whole timing is slowed down by up to 0.15 %."""


def result_code(
    xp: Any,
    code: Any,
    searched: tuple[Any, list[Found]],
    speeds: tuple[Any, Any],
    finite: tuple[Any, Scalar],
) -> Any:
    """Return the `ResultCode`: the first of several failures, or else the `code` of the certificate.

    `searched` contains whether all searches converged, and their results. `speeds` are the speeds at both ends and the
    prescribed speeds; the numbers `finite` must be finite.
    """
    (found, searches), (ends, wanted) = searched, speeds
    missed = xp.any(xp.isfinite(wanted) & (ends < wanted * (1 - REACHED)))
    # Rest at an end changes the structure of the problem, so it must be known: report a traced speed of zero.
    ignored = xp.any((wanted <= 0) & (ends > 0))
    is_finite = xp.isfinite(finite[0]).all() & xp.isfinite(xp.asarray(finite[1]))
    for failed, result in (
        (missed, ResultCode.end_speed_not_reached),
        (~found, ResultCode.not_converged),
        (~is_finite, ResultCode.not_finite),
        (xp.any(xp.stack([x.unbounded for x in searches])), ResultCode.speed_unbounded),
        (ignored, ResultCode.rest_unknown),
        (xp.isnan(wanted).any(), ResultCode.not_finite),
    ):
        code = xp.where(failed, int(result), code)
    return code


def accuracy_code(time: float, wanted: float | None, gap: float, tolerance: float) -> np.ndarray:
    """Return the code of a successful timing, which may miss the prescribed duration `wanted`, or the tolerance."""
    code = ResultCode.successful
    if wanted is not None and time > (1 + tolerance) * wanted:
        code = ResultCode.duration_too_short
    elif wanted is not None and time < (1 - 2 * tolerance) * wanted:
        code = ResultCode.duration_too_long
    elif gap > tolerance:  # false for NaN
        code = ResultCode.not_converged
    return np.asarray(int(code))
