"""Certify all limits on a retimed path; the certificate of `retime` is reused, so no limit is proved twice."""

from __future__ import annotations  # so that `help` shows short names

from typing import cast

from qtraj.design.limits import Limits
from qtraj.design.obstacles.certificate import with_obstacles
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify
from qtraj.design.timing.findings import joined
from qtraj.design.timing.outcome import Retimed


def whole_certificate(timed: Retimed, limits: Limits) -> Certificate:
    """Return the certificate of a result of `retime`, with findings on the `limits` that `retime` does not support.

    Limits on the shape, such as a limit on the curvature, are proved on the original path, which has the same shape.
    Other limits, such as a limit on the angular acceleration, are sampled. Obstacles are checked as by `certify`. If
    `retime` supports all limits, the certificate of its result is returned.

    **Raises:** ValueError in the same cases as `certify`.
    """
    own = timed.certificate
    others = limits.only([name for name in limits.given() if name not in own.names])
    if not others.given():
        return with_obstacles(own, timed.path, limits)
    found = cast(Certificate, certify(timed.path, others))  # only a route has a certificate of another class
    return with_obstacles(joined([own, found], (*own.names, *found.names)), timed.path, limits)
