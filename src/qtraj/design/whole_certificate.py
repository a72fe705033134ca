"""Add limits on the shape of a path to the certificate of its retiming, which avoids a second proof of the timing."""

from __future__ import annotations  # so that `help` shows short names

import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.timing.outcome import Retimed


def whole_certificate(timed: Retimed, limits: Limits) -> Certificate:
    """Return the certificate of a result of `retime` with the limits on the shape in `limits` added.

    `retime` proves only limits that depend on the timing. Limits on the shape, such as curvature, are checked on the
    original path, which has the same shape; the times [s] of their findings refer to the retimed path. If `limits` has
    no limit on the shape, the result is the certificate of the retiming.

    **Raises:** ValueError in the same cases as `certify`.
    """
    shape, own = limits.on_shape(), timed.certificate
    if not shape.given():
        return own
    found = certify(timed.path.path, shape)
    found = found.whole if isinstance(found, RouteCertificate) else found
    times = np.array([float(timed.timing.time(t)) for t in np.asarray(found.times)])
    ours, theirs = (own.codes, own.times, own.values, own.limits), (found.codes, times, found.values, found.limits)
    columns = (np.concatenate(pair) for pair in zip(ours, theirs, strict=True))
    return Certificate((*own.names, *found.names), *columns)
