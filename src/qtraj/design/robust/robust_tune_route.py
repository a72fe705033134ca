"""Tune a route within tightened limits, so that the limits are satisfied with a stated probability."""

from __future__ import annotations  # so that `help` shows short names

from typing import Any

from qtraj.design.limits import Limits, require_limits
from qtraj.design.robust.driven_route import driven_route
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.robust.spread import Spread
from qtraj.design.robust.to_share import require_share, tuned_to_share
from qtraj.design.tuning_route.tune_route import tune_route
from qtraj.foundation.argument import require_type
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.signature import require_options
from qtraj.path.route import Route


@of_one_device
def robust_tune_route(
    route: Route,
    limits: Limits,
    spread: Spread,
    share: float = 0.99,
    *,
    samples: int = 8192,
    seed: int = 0,
    **options: Any,
) -> RobustTuned:
    """Tune a route so that all limits are satisfied with the probability `share`, although states and limits deviate.

    The states at both ends of the tuned route deviate by independent normal errors: the vehicle enters and leaves it
    with another position and velocity. Its first segment leads from the state that it has to the second joint, its last
    segment from the last joint but one to the state with which it ends, in the same times. All other segments are those
    of the tuned route. Limits with a standard deviation, such as the friction, deviate on the whole route.

    The margins of the limits are found as in `robust_tune`: standard deviations of first order of the largest values,
    times a factor with which the share of `samples` routes that satisfy all limits is `share` to 0.05 %. The routes
    are not linearised. The tube and `fixed` refer to the tuned route, not to those that deviate.

    Args:
        route: An open `Route` without stops, as for `tune_route`.
        limits: Limits that do not change along the way or with the speed, without obstacles.
        spread: The standard deviations.
        share: The probability that all limits are satisfied, from 0.5 to 0.9999.
        samples: Number of sampled routes, a power of two from 256 to 2²⁰; the error of the share is about
            √(share (1 − share) / samples) or less.
        seed: Seed of the samples; equal seeds give equal results.
        **options: Other arguments of `tune_route`, such as `tube` or `fixed`. By default, the states at both ends are
            fixed: if a limit is active there, free them.

    Returns:
        A `RobustTuned` with the tuned route in `tuned`, the tightened limits and the sampled share.

    Raises:
        ValueError: For another `share` or number of samples, a route with stops or that is closed, limits that change,
            and a limit in `spread` that is not limited; and the errors of `tune_route`.

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
    require_share("robust_tune_route", limits, spread, share, samples, seed)
    if route.progress is not None:
        raise ValueError("robust_tune_route needs a route without stops: pass a window between two stops")
    if options.get("closed"):
        raise ValueError("a closed route has no ends whose states deviate: pass an open route, or use tune_route")
    if limits.along_road:
        raise ValueError("robust_tune_route needs a road that does not change along the way: pass a constant road")
    return tuned_to_share(
        lambda tight: tune_route(route, tight, **options),
        lambda tuned: driven_route(tuned, limits),
        limits,
        spread,
        share,
        samples,
        seed,
    )
