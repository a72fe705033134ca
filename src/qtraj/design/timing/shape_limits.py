"""Limits that no timing changes, in `retime`: on quantities of the shape, and obstacles that do not move.

They are checked once, on the original path, and added to the certificate of the result.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import PROVED
from qtraj.design.timing.outcome import Retimed
from qtraj.design.whole_certificate import whole_certificate
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.outcome import FAILURES


def require_checkable(limits: Limits, path: Any, speeds: Any) -> None:
    """Raise an error for obstacles that move, and for limits on the shape or obstacles if a value is traced."""
    for k, obstacle in enumerate(limits.keep_out or ()):
        if obstacle.moves:
            raise ValueError(
                f"retime does not support obstacles that move, but keep_out[{k}] does: remove it, and check the path "
                "of the result with qtraj.certify"
            )
    given = [*limits.on_shape().given(), *(["keep_out"] if limits.keep_out else [])]
    if given and is_traced(path, limits, speeds):
        raise ValueError(
            f"the limit {given[0]} does not depend on the timing, and retime checks it only for a path, limits and "
            "speeds with concrete values: inside jit, grad and vmap, remove it, and check the path with qtraj.certify"
        )


def with_shape_limits(timed: Retimed, limits: Limits) -> Retimed:
    """Return the result with findings on the limits on the shape and on obstacles; unchanged without such limits.

    The usage of these limits is NaN.
    """
    if not (limits.on_shape().given() or limits.keep_out):
        return timed
    own = timed.certificate
    found = whole_certificate(timed, limits)
    more, cells = len(found.names) - len(own.names), timed.usage.shape[-1]
    usage = np.concatenate([np.asarray(timed.usage), np.full((more, cells), np.nan)])
    bounds = timed.bounds
    if bounds is not None:
        rest = np.asarray(found.limits)[len(own.names) :, None]
        bounds = np.concatenate([np.asarray(bounds), np.repeat(rest, cells, axis=1)])
    of_timing = int(np.asarray(timed.code))
    broken = of_timing < FAILURES and (np.asarray(found.codes)[len(own.names) :] != PROVED).any()
    code = found.code if broken or of_timing == int(np.asarray(own.code)) else timed.code
    return eqx.tree_at(
        lambda x: (x.certificate, x.usage, x.bounds, x.code),
        timed,
        (found, usage, bounds, code),
        is_leaf=lambda x: x is None,
    )
