"""A recorded turn as a spiral-helix: least squares over axis, radius, angle and height.

The height is linear and separate. In the horizontal plane the axis (x, y) and the polynomials of ρ and φ are found by
Levenberg–Marquardt from several starts, in lengths of the mean turning radius R = L/|θ| (path length over the turn of
the travel direction) about the centre of the window, so that large world coordinates cost no digits.

Left alone, the axis runs away: polynomials of ρ and φ about a far axis, or one that the path touches, draw almost any
curve. So ρ is held within bounds, R/4 to 2R unless told otherwise: the axis stays inside the bend.
An augmented Lagrangian meets the bounds: a search, then multipliers from how far ρ is outside, then a search again.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from numpy.polynomial import Legendre, Polynomial

from qtraj.design.fitting.axis_search import STARTS, starts
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.quality import Quality, judged, speed_misfit
from qtraj.design.fitting.radius_bounds import held, inside
from qtraj.design.fitting.turn_problem import PENALTY, POINTS, TERMS, UNKNOWNS, basis_at, minimise, problem
from qtraj.design.fitting.window import POSITION_SIGMA, VELOCITY_SIGMA, turn_of
from qtraj.foundation.arrays import as_array
from qtraj.foundation.outcome import ResultCode
from qtraj.motion.attitude_residual import compare_attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.placement import Placement
from qtraj.path.residual import compare
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track, elapsed_times, to_float64
from qtraj.path.trihedral import Upright

ANGLE_TERMS = {"uniform": 2, "hermite": 4}
"""Coefficients of φ in each motion: linear, or cubic as between two boundary states."""

BOUNDS = (0.25, 2.0)
"""Default bounds of ρ in mean turning radii."""

ROUNDS, OUTSIDE = 15, 1e-6
"""Most searches with new multipliers, which end where ρ leaves its bounds by no more than this, in turning radii."""


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
    """The spiral-helix about a vertical axis that follows `track` best; path time 0 is its first sample.

    `motion`: "hermite" (cubic φ, which follows a driver who slows down and speeds up) or "uniform" (constant φ̇, as in
    paper S); ρ and h are cubics. To tune the path, pass the same motion to `tune`. Minimised is the sum of squared
    position errors over `position_sigma` [m] and, where velocities are recorded, of squared velocity errors over
    `velocity_sigma` [m/s]: their ratio weighs the two, and windows shorter than 200 `position_sigma` are refused.
    `radius_bounds` [m] hold ρ on the whole path: by default a quarter and twice the mean turning radius.

    The result's `path` is the fitted one, its `residual` says how well that follows the track, and its `result` how the
    search ended and what to do, also where a bound holds the radius. A fit is loose, which its `code` and `result` say,
    where the root mean square of the horizontal distance is more than 3 % of the turn's radius (its length over all
    that it turns) or the speed differs somewhere by more than 25 % of the recorded one (its root mean square); beyond
    10 % or 50 % it is poor and counts as a failure. Recorded attitudes do not enter the fit; the result's `attitude`
    compares them with the upright frame of the path, by `compare_attitude`. Use float64. The data must be known
    numbers: gradients do not pass through the fit, but the fitted path has them like any other.

    **Raises:** ValueError for an unknown motion, sigmas or bounds that are not positive, too few samples, or a window
    in which the vehicle stands, hardly moves, or drives nearly straight on or through bends that cancel. RuntimeError
    with `throw` where the search did not converge, or the fit is poor.
    """
    if motion not in ANGLE_TERMS:
        raise ValueError(f"motion={motion!r} is unknown: choose one of {', '.join(map(repr, ANGLE_TERMS))}")
    _require_positive(position_sigma=position_sigma, velocity_sigma=velocity_sigma, max_steps=max_steps)
    turn = turn_of(track, position_sigma)
    scale = turn.radius
    bounds = (BOUNDS[0] * scale, BOUNDS[1] * scale) if radius_bounds is None else _ordered(radius_bounds)
    centre = to_float64(track.positions).mean(axis=0)
    ratio = position_sigma / velocity_sigma
    unknowns, ended, steps = _in_the_plane(track, centre, scale, bounds, ratio, ANGLE_TERMS[motion], max_steps)
    height = _height(track, centre[2], ratio)

    duration, dtype = float(elapsed_times(track)[-1]), track.positions.dtype
    radius = inside(_ascending(unknowns[2 : 2 + TERMS], duration) * scale, duration, bounds)
    angle = _ascending(unknowns[2 + TERMS :][: ANGLE_TERMS[motion]], duration)
    angle[0] -= 2 * np.pi * np.round(angle[0] / (2 * np.pi))
    numbers = (radius, angle, _ascending(height, duration), duration)
    axis = [*(centre[:2] + scale * unknowns[:2]), 0.0]
    placement = Placement(as_array(axis, dtype), as_array([1.0, 0.0, 0.0, 0.0], dtype))
    path = SpiralHelix(*(as_array(x, dtype) for x in numbers), placement=placement)

    residual = compare(path, track)
    found = Quality(float(residual.horizontal_rms) / turn.bent, speed_misfit(path, track))
    attitude = None if track.attitudes is None else compare_attitude(FrameProgram(path, Upright()), track)
    fitted = Fitted(path, residual, _code(radius, duration, bounds, ended, found), steps, bounds, *found, attitude)
    return fitted.check() if throw else fitted


def _in_the_plane(
    track: Track,
    centre: np.ndarray,
    scale: float,
    bounds: tuple[float, float],
    ratio: float,
    angle_terms: int,
    max_steps: int,
) -> tuple[np.ndarray, bool, int]:
    """Axis, ρ and φ in lengths of `scale` about `centre`, of the best of several searches; whether it ended; steps."""
    positions = (to_float64(track.positions)[:, :2] - centre[:2]) / scale
    basis, _ = basis_at(elapsed_times(track))
    found = starts(positions, basis, angle_terms, (bounds[0] / scale, bounds[1] / scale))
    if not found:
        raise ValueError(
            f"no spiral-helix with a radius between {bounds[0]:.4g} and {bounds[1]:.4g} m could be laid along this "
            "window. Choose a window with one bend, or pass other radius_bounds."
        )
    begin = np.zeros((STARTS, UNKNOWNS))
    begin[:, : 2 + TERMS + angle_terms] = [found[k % len(found)] for k in range(STARTS)]
    free = np.arange(UNKNOWNS) < 2 + TERMS + angle_terms
    turn = problem(track, centre, scale, bounds, ratio)
    unknowns, shifts = as_array(begin, float), as_array(np.zeros((STARTS, 2, POINTS)), float)
    total, rounds = np.zeros(STARTS, int), 0
    while True:
        searches = minimise(turn, unknowns, shifts, as_array(free, float), as_array(max_steps, jnp.int32))
        unknowns, excess, misfit, ended, steps = searches
        outside, total, rounds = np.asarray(excess).max(axis=(1, 2)), total + np.asarray(steps), rounds + 1
        best = _best(np.asarray(misfit), outside)
        met = bool(outside[best] <= OUTSIDE)
        if met or not ended[best] or rounds == ROUNDS:
            return np.asarray(unknowns[best], np.float64), met and bool(ended[best]), int(total[best])
        shifts = jnp.maximum(shifts + excess, 0.0)


def _best(misfit: np.ndarray, outside: np.ndarray) -> int:
    """The search with the least penalised misfit: what leaves the bounds counts by its square."""
    cost = misfit + PENALTY**2 * np.maximum(outside, 0.0) ** 2
    return int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))


def _height(track: Track, level: float, ratio: float) -> np.ndarray:
    """Legendre coefficients of h by weighted linear least squares."""
    basis, slope = basis_at(elapsed_times(track))
    rows, values = basis, to_float64(track.positions)[:, 2] - level
    if track.velocities is not None:
        rows = np.concatenate([rows, ratio * slope])
        values = np.concatenate([values, ratio * to_float64(track.velocities)[:, 2]])
    coefficients = np.linalg.lstsq(rows, values, rcond=None)[0]
    coefficients[0] += level
    return coefficients


def _ascending(coefficients: np.ndarray, duration: float) -> np.ndarray:
    """Ascending coefficients in t [s] of a Legendre series over [0, duration]."""
    series = Legendre(coefficients, domain=(0.0, duration)).convert(kind=Polynomial, domain=(-1, 1), window=(-1, 1))
    return np.pad(series.coef, (0, len(coefficients) - len(series.coef)))


def _code(radius: np.ndarray, duration: float, bounds: tuple[float, float], ended: bool, found: Quality) -> ResultCode:
    """How a fit ended whose path has these coefficients of ρ."""
    if not ended:
        return ResultCode.not_converged
    if (code := judged(found)) != ResultCode.successful:
        return code
    return ResultCode.held_by_bounds if held(radius, duration, bounds) else ResultCode.successful


def _ordered(bounds: Sequence[float | int]) -> tuple[float, float]:
    if len(bounds) != 2 or not 0 < bounds[0] < bounds[1] < np.inf:
        raise ValueError(f"radius_bounds must be (low, high) with 0 < low < high [m], but {bounds!r} was given")
    return float(bounds[0]), float(bounds[1])


def _require_positive(**numbers: float | int) -> None:
    for name, value in numbers.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive, but {value!r} was given")
