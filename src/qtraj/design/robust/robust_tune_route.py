"""Tune a route within tightened limits, so that the limits are satisfied with a stated probability, or always."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any, overload

from qtraj.design.limits import Limits, require_limits
from qtraj.design.robust.box import STATES, Box
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.box_requirements import require_box_limits, require_no_stops, require_states
from qtraj.design.robust.driven_route import driven_route
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.route_box import RouteBoxProblem
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.to_share import require_share, tuned_to_share
from qtraj.design.robust.tune_in_box import tune_in_box
from qtraj.design.tuning_route.tune_route import tune_route
from qtraj.foundation.argument import require_type
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.signature import require_options
from qtraj.path.route import Route


@overload
def robust_tune_route(route: Route, limits: Limits, spread: Box, **options: Any) -> BoxTuned: ...
@overload
def robust_tune_route(
    route: Route,
    limits: Limits,
    spread: Spread,
    share: float = 0.99,
    *,
    samples: int = 8192,
    seed: int = 0,
    **options: Any,
) -> RobustTuned: ...
@of_one_device
def robust_tune_route(
    route: Route,
    limits: Limits,
    spread: Spread | Box,
    share: float = 0.99,
    *,
    samples: int = 8192,
    seed: int = 0,
    **options: Any,
) -> RobustTuned | BoxTuned:
    """Tune a route so that limits are satisfied although states deviate: with the probability `share`, or always.

    With a `Box` of intervals, the limits are satisfied for all deviations in it, and `certify_box` proves this on each
    segment; the limits are tightened as in `robust_tune`.

    With a `Spread`, the states at both ends of the tuned route deviate by independent normal errors: the vehicle enters
    and leaves it with another position and velocity. Its first segment leads from the state that it has to the second
    joint, its last segment from the last joint but one to the state with which it ends, in the same times. All other
    segments are those of the tuned route. Limits with a standard deviation, such as the friction, deviate on the whole
    route. With a `Box`, the routes are the same.

    The margins of the limits are found as in `robust_tune`: standard deviations of first order of the largest values,
    times a factor with which the share of `samples` routes that satisfy all limits is `share` to 0.05 %. The routes
    are not linearised. The tube and `fixed` refer to the tuned route, not to those that deviate.

    Args:
        route: An open `Route` without stops, as for `tune_route`.
        limits: Limits that do not change along the way or with the speed, without obstacles.
        spread: The standard deviations, or a `Box`.
        share: The probability that all limits are satisfied, from 0.5 to 0.9999; `share`, `samples` and `seed` are only
            for a `Spread`.
        samples: Number of sampled routes, a power of two from 256 to 2²⁰; the error of the share is about
            √(share (1 − share) / samples) or less.
        seed: Seed of the samples; equal seeds give equal results.
        **options: Other arguments of `tune_route`, such as `tube` or `fixed`. By default, the states at both ends are
            fixed: if a limit is active there, free them.

    Returns:
        A `RobustTuned` with the tuned route in `tuned`, the tightened limits and the sampled share; for a `Box`, a
        `BoxTuned` with the proof in `certificate`.

    Raises:
        ValueError: For another `share` or number of samples, a route with stops or that is closed, limits that change,
            and a limit in `spread` that is not limited; and the errors of `tune_route`, for a `Box` also those of
            `certify_box`.

    Example:
        >>> import numpy as np
        >>> import qtraj as qt
        >>> t = np.linspace(0, 8, 5)
        >>> r = 20 * np.stack([np.sin(0.3 * t), np.cos(0.3 * t), 0 * t], axis=1)
        >>> v = 6 * np.stack([np.cos(0.3 * t), -np.sin(0.3 * t), 0 * t], axis=1)
        >>> route = qt.Route(t, r, v, -0.09 * r)
        >>> limits, spread = qt.Limits(lateral_acceleration=2.0), qt.Spread(limits={"lateral_acceleration": 0.1})
        >>> found = qt.robust_tune_route(route, limits, spread, fixed=np.zeros(5, bool))
        >>> round(float(found.sampled_share), 2)
        0.99
    """
    require_type(route, Route, "route", "a Route, such as the path of fit_route")
    require_limits(limits)
    require_options(robust_tune_route, options, tune_route)
    in_box = isinstance(spread, Box)
    if in_box and (share, samples, seed) != (0.99, 8192, 0):
        raise ValueError("share, samples and seed are only for a Spread: with a Box, all deviations count")
    if not in_box:
        require_share("robust_tune_route", limits, spread, share, samples, seed)
    require_no_stops(route, "robust_tune_route")
    if options.get("closed") and (not in_box or any(name in STATES for name in spread.names)):
        raise ValueError("a closed route has no ends whose states deviate: pass an open route, or use tune_route")
    if limits.along_road:
        raise ValueError("robust_tune_route needs a road that does not change along the way: pass a constant road")
    if in_box:
        require_box_limits(limits, spread, "robust_tune_route")
        require_states(spread, of_route=True)
        return tune_in_box(
            lambda tight: tune_route(route, tight, **options),
            lambda tuned: RouteBoxProblem.of(tuned.path, limits, spread),
            limits,
            spread,
        )
    return tuned_to_share(
        lambda tight: tune_route(route, tight, **options),
        lambda tuned: driven_route(tuned, limits),
        limits,
        spread,
        share,
        samples,
        seed,
    )
