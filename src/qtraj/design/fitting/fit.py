"""Fit a spiral-helix to a recorded turn by least squares.

The polynomial of the height h is the solution of a separate, linear problem. In the horizontal plane, the
Levenberg–Marquardt method finds the axis (x, y) and the polynomials of the radius ρ and the azimuth φ, from several
starting points. The unit of length is the mean turning radius R = L/|θ|, where L is the path length and θ the angle by
which the travel direction turns. The origin is the centre of the window, so that large world coordinates do not reduce
the precision.

Without bounds the axis would diverge, because polynomials of ρ and φ about a far axis, or about an axis that touches
the path, fit almost any curve. Therefore ρ is bounded, by default to the interval [R/4, 2R]. These bounds keep the axis
close to the bend. The augmented Lagrangian method enforces the bounds: searches alternate with updates of the
multipliers.
"""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Sequence

import jax
import numpy as np
from numpy.polynomial import Legendre, Polynomial

from qtraj.design.fitting.axis_search import starts
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.quality import Quality, judge, speed_misfit
from qtraj.design.fitting.radius_bounds import is_at_bound, shrink_into_bounds
from qtraj.design.fitting.turn_covariance import covariance_factor
from qtraj.design.fitting.turn_problem import PENALTY, POINTS, TERMS, legendre_basis, minimise, problem
from qtraj.design.fitting.window import POSITION_SIGMA, VELOCITY_SIGMA, measure_turn
from qtraj.foundation.arrays import like
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.namespace import on_host
from qtraj.foundation.outcome import ResultCode
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.placement import Placement
from qtraj.path.residual import compare
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track, elapsed_times, require_track, to_float64
from qtraj.path.trihedral import Upright

ANGLE_TERMS = {"uniform": 2, "hermite": 4}
"""Number of coefficients of φ for each motion: φ is linear in time for uniform motion, and cubic for Hermite motion."""

BOUNDS = (0.25, 2.0)
"""Default bounds of ρ, in units of the mean turning radius."""

ROUNDS, BOUND_TOLERANCE = 15, 1e-6
"""Maximum number of searches (between multiplier updates), and the tolerance on the bounds of ρ.

The tolerance is in units of the mean turning radius.
"""


@of_one_device
def fit(
    track: Track,
    motion: str = "hermite",
    position_sigma: float | int = POSITION_SIGMA,
    velocity_sigma: float | int = VELOCITY_SIGMA,
    radius_bounds: Sequence[float | int] | None = None,
    max_steps: int = 256,
    *,
    throw: bool = False,
) -> Fitted:
    """Fit a spiral-helix about a vertical axis to `track`; time 0 of the path is the time of the first sample.

    `motion` is "hermite" (the azimuth φ is cubic in time, for a vehicle that changes its speed) or "uniform" (φ̇ is
    constant, as in paper S). The radius ρ and the height h are cubics in time. To tune the path, pass the same motion
    to `tune`.

    The fit minimises the sum of (position error / `position_sigma` [m])² over the samples and, if velocities are
    recorded, of (velocity error / `velocity_sigma` [m/s])². Only the ratio of the sigmas changes the path. Windows
    shorter than 200 `position_sigma` are rejected. `radius_bounds` (low, high) [m] bound ρ on the whole path. The
    default is from a quarter of the mean turning radius to twice this radius.

    The result contains the fitted `path`, the `residual` of the fit, and a `result` text with advice. A fit is loose if
    the RMS horizontal distance of the samples from the path exceeds 3 % of the radius of the turn (its length divided
    by its total turning angle), or if the speed differs from the recorded speed by more than 25 % of the RMS recorded
    speed. If these values exceed 10 % or 50 %, respectively, the fit is poor; a poor fit counts as a failure. The fit
    does not use recorded attitudes. The field `attitude` of the result contains the differences between recorded
    attitudes and the upright frame of the path (see `compare_attitude`).

    Use float64 and concrete values: the fit is not differentiable with respect to the recording. The fitted path is
    differentiable like any other path.

    **Raises:** ValueError for an unknown motion, for sigmas, bounds or `max_steps` that are not positive, for bounds
    that allow no fit, for too few samples, or if the vehicle stands still, hardly moves, drives nearly straight, or
    drives through bends that cancel each other. RuntimeError with `throw` if the search did not converge or the fit is
    poor.
    """
    if motion not in ANGLE_TERMS:
        raise ValueError(f"motion={motion!r} is unknown: choose one of {', '.join(map(repr, ANGLE_TERMS))}")
    require_track(track)
    _require_positive(position_sigma=position_sigma, velocity_sigma=velocity_sigma, max_steps=max_steps)
    turn = measure_turn(track, position_sigma, velocity_sigma)
    scale = turn.radius
    bounds = (BOUNDS[0] * scale, BOUNDS[1] * scale) if radius_bounds is None else _checked_bounds(radius_bounds)
    centre = to_float64(track.positions).mean(axis=0)
    ratio = position_sigma / velocity_sigma
    unknowns, converged, steps = _fit_plane(track, centre, scale, bounds, ratio, ANGLE_TERMS[motion], max_steps)
    height = _height(track, centre[2], ratio)

    duration = float(elapsed_times(track)[-1])
    radius = shrink_into_bounds(_ascending(unknowns[2 : 2 + TERMS], duration) * scale, duration, bounds)
    angle = _ascending(unknowns[2 + TERMS :][: ANGLE_TERMS[motion]], duration)
    angle[0] -= 2 * np.pi * np.round(angle[0] / (2 * np.pi))
    numbers = (radius, angle, _ascending(height, duration), duration)
    axis = [*(centre[:2] + scale * unknowns[:2]), 0.0]
    *polynomials, axis, upright = (like(np.asarray(x), track.positions) for x in (*numbers, axis, [1.0, 0.0, 0.0, 0.0]))
    path = SpiralHelix(*polynomials, placement=Placement(axis, upright))

    residual = compare(path, track)
    quality = Quality(float(residual.horizontal_rms) / turn.total_radius, speed_misfit(path, track))
    attitude = None if track.attitudes is None else compare_attitude(FrameProgram(path, Upright()), track)
    code = _code(radius, duration, bounds, converged, quality)
    factor = covariance_factor(jax.tree.map(on_host, path), track, ratio)
    fitted = Fitted(path, residual, code, steps, bounds, *quality, attitude, factor)
    return fitted.check() if throw else fitted


def _fit_plane(
    track: Track,
    centre: np.ndarray,
    scale: float,
    bounds: tuple[float, float],
    ratio: float,
    angle_terms: int,
    max_steps: int,
) -> tuple[np.ndarray, bool, int]:
    """Return the best result of several searches, whether it converged, and its number of steps.

    The result is a vector of the axis (x, y) and the coefficients of ρ and φ, relative to `centre` [m] and in units of
    `scale` [m].
    """
    positions = (to_float64(track.positions)[:, :2] - centre[:2]) / scale
    basis, _ = legendre_basis(elapsed_times(track))
    axes = starts(positions, basis, angle_terms, (bounds[0] / scale, bounds[1] / scale))
    if not axes:
        raise ValueError(
            f"no spiral-helix with a radius between {bounds[0]:.4g} and {bounds[1]:.4g} m could be fitted to this "
            "window. Choose a window with one bend, or pass different radius_bounds."
        )
    turn = problem(track, centre, scale, bounds, ratio)
    unknowns, shifts = np.stack(axes), np.zeros((len(axes), 2, POINTS))
    total, rounds = np.zeros(len(axes), int), 0
    while True:
        search = minimise(turn, unknowns, shifts, int(max_steps))
        unknowns, converged = search.unknowns, search.converged
        max_violation, total, rounds = search.violations.max(axis=(1, 2)), total + search.steps, rounds + 1
        best = _best(search.misfit, max_violation)
        bounds_met = bool(max_violation[best] <= BOUND_TOLERANCE)
        if bounds_met or not converged[best] or rounds == ROUNDS:
            return unknowns[best], bounds_met and bool(converged[best]), int(total[best])
        shifts = np.maximum(shifts + search.violations, 0.0)


def _best(misfit: np.ndarray, max_violation: np.ndarray) -> int:
    """Return the index of the search with the smallest misfit plus penalty for violated bounds."""
    cost = misfit + PENALTY**2 * np.maximum(max_violation, 0.0) ** 2
    return int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))


def _height(track: Track, level: float, ratio: float) -> np.ndarray:
    """Return the Legendre coefficients of the height h by weighted linear least squares."""
    basis, slope = legendre_basis(elapsed_times(track))
    matrix, values = basis, to_float64(track.positions)[:, 2] - level
    if track.velocities is not None:
        matrix = np.concatenate([matrix, ratio * slope])
        values = np.concatenate([values, ratio * to_float64(track.velocities)[:, 2]])
    coefficients = np.linalg.lstsq(matrix, values, rcond=None)[0]
    coefficients[0] += level
    return coefficients


def _ascending(coefficients: np.ndarray, duration: float) -> np.ndarray:
    """Convert a Legendre series over [0, `duration`] to the coefficients of ascending powers of the time t [s]."""
    series = Legendre(coefficients, domain=(0.0, duration)).convert(kind=Polynomial, domain=(-1, 1), window=(-1, 1))
    return np.pad(series.coef, (0, len(coefficients) - len(series.coef)))


def _code(
    radius: np.ndarray, duration: float, bounds: tuple[float, float], converged: bool, quality: Quality
) -> ResultCode:
    """Return the result code of a fit, where `radius` contains the coefficients of ρ."""
    code = judge(quality)
    if not converged and code != ResultCode.poor_fit:
        return ResultCode.not_converged
    if code != ResultCode.successful:
        return code
    return ResultCode.held_by_bounds if is_at_bound(radius, duration, bounds) else ResultCode.successful


def _checked_bounds(bounds: Sequence[float | int]) -> tuple[float, float]:
    if len(bounds) != 2 or not 0 < bounds[0] < bounds[1] < np.inf:
        raise ValueError(f"radius_bounds must be (low, high) with 0 < low < high [m], but {bounds!r} was given")
    return float(bounds[0]), float(bounds[1])


def _require_positive(**numbers: float | int) -> None:
    for name, value in numbers.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive, but {value!r} was given")
