"""Prove limits for all deviations in a box."""

from __future__ import annotations  # so that `help` shows short names

from qtraj.design.limits import Limits
from qtraj.design.robust.box import Box
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_problem import BoxProblem
from qtraj.design.robust.box_requirements import require_box
from qtraj.design.robust.route_box import RouteBoxProblem
from qtraj.foundation.devices import of_one_device
from qtraj.path.route import Route
from qtraj.path.spiral_helix import SpiralHelix


@of_one_device
def certify_box(path: SpiralHelix | Route, limits: Limits, box: Box, *, throw: bool = False) -> BoxCertificate:
    """Prove that all paths near a path satisfy `limits`, for every combination of deviations in `box`.

    The states at the ends of the path deviate. The vehicle then drives the spiral-helix whose radius, azimuth and
    height differ from those of `path` by the cubics that change these states and no other ones, in the same time. Of a
    route, the first and the last segment differ, by quintics, and lead to the same joints in the same times. Along such
    a path, a limit is an inequality between polynomials in the time and in the deviations, and it is decided for
    all of them at once, in exact integers where floats do not suffice (docs/howto/robust.md). The mass and the drag
    area enter in the same way; of limits that deviate, the strictest value is proved. Nothing is linearised or sampled.

    Args:
        path: One spiral-helix, or one route without stops, with concrete values.
        limits: Limits that do not change along the way or with the speed, without obstacles and own quantities.
        box: The intervals of the deviations: at most three besides those of limits.
        throw: Raise an error if a limit is not proved.

    Returns:
        A `BoxCertificate` with a status for each limit: "proved" for all deviations; "broken", with deviations that
        violate it; "undefined", if the speed or another divisor is zero for some deviations; or "undecided", if the
        quantity touches its limit, or the proof takes too long, as for the angular acceleration and two parameters.

    Raises:
        ValueError: For a path of another kind, a batch, a route with stops, states of the other kind of path, limits
            that change or need another axis, a mass or drag area without vehicle, and deviations of limits that are not
            set or reach zero.
        RuntimeError: With `throw`, if a limit is not proved.

    Example:
        >>> import qtraj as qt
        >>> start = qt.BoundaryState([20, 0, 0], [0, 6, 0])
        >>> end = qt.BoundaryState([0, 22, 1], [-6, 0, 0.2])
        >>> path = qt.SpiralHelix.hermite(start, end, 5.5)
        >>> qt.certify_box(path, qt.Limits(speed=7.0), qt.Box(start_speed=0.3, end_speed=0.3)).status
        {'speed': 'proved'}
    """
    require_box(path, limits, box)
    problem = RouteBoxProblem.of(path, limits, box) if isinstance(path, Route) else BoxProblem.of(path, limits, box)
    found = problem.certificate()
    return found.check() if throw else found
