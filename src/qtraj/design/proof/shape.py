"""Certify limits on a shape, which has no times: only limits on quantities such as the curvature."""

from qtraj.design.limits import Limits
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.path.shape import Shape


def certify_shape(shape: Shape, limits: Limits) -> RouteCertificate:
    """Return the certificate of a shape for `limits`; its times are parameters of `shape.route`.

    **Raises:** ValueError for a limit on a quantity that depends on the times.
    """
    allowed = limits.on_shape()
    others = [name for name in limits.given() if name not in allowed.given()]
    if others:
        raise ValueError(
            f"a shape has no times, so limits on {', '.join(others)} cannot be checked on it. Compute its fastest "
            "timing with qtraj.retime(shape, limits), or remove these limits; curvature, horizontal_curvature, "
            "steering_angle, sharpness, torsion and slope need no times."
        )
    return certify_route(shape.route, allowed)
