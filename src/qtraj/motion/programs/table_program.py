"""Define a program that interpolates a table of attitudes by the C² rotation spline."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import as_float, as_seconds, concrete, one_instant, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy_or_jit, of_arrays, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import shared_dtype
from qtraj.motion.programs import rotation_spline as spline
from qtraj.motion.programs.euler_turn import attitude_table

OUTSIDE = ("error", "hold", "extrapolate")
"""What a program does outside its table."""

SLACK = 4 * float(np.finfo(np.float32).eps)
"""Times may exceed the table by this fraction of its duration, to allow for rounding errors."""

HALF_TURN = 1e-6
"""Neighbouring attitudes must be closer than a half turn by more than this angle [rad]; files round quaternions."""


@storable
class TableProgram(AbstractProgram):
    """The rotation spline through `quaternions` (n, 4) at `times` (n,) [s], n ≥ 2, with continuous acceleration.

    The quaternions need not be normalised and may have either sign; they are stored with continuous signs. The
    program's quaternion has norm 1, is continuous and starts with the sign of the first quaternion. Neighbouring
    attitudes are connected by the shorter rotation, which must be less than a half turn, because the axis of a half
    turn between two attitudes is arbitrary. The rates at both ends are the mean rates of the first and the last
    interval. The spline is the same as SciPy's RotationSpline if SciPy's iteration converges. SciPy stops it after ten
    iterations or at a relative change of 1e-9; its acceleration may then jump. At equal intervals, its attitudes differ
    by 1e-8 rad for steps of 2 rad and by 4e-6 rad for steps of 2.5 rad. At intervals that differ by a factor of up to
    100, they differ by up to 1e-3 rad for steps of 0.9 rad, and by more for larger steps.

    Program time is measured from times[0]. `outside` determines what happens outside [0, duration]: "error" raises an
    error (NaN for traced times), "hold" keeps the first and the last attitude at rest, and "extrapolate" continues the
    first and the last polynomial, whose rates soon become very large.

    `rates` (n, 3) [rad/s]: the angular rates at the attitudes, body axes. With None, the rates are computed and stored
    when the program is created; for traced attitudes, they are NaN if the iteration does not converge, or if
    neighbouring attitudes are a half turn apart. If you pass `rates`, they are not changed, and the acceleration may
    jump. First and second derivatives with respect to the table are exact.

    **Raises:** ValueError for fewer than two attitudes, times that do not increase, wrong shapes, values that are not
    finite, a zero quaternion, neighbouring attitudes that are a half turn apart to within 1e-6 rad, attitudes that are
    too far apart for the iteration to converge, or an unknown `outside`; at a call, for a time outside [0, duration].
    """

    times: Float[Array, " n"]
    quaternions: Float[Array, "n 4"]
    rates: Float[Array, "n 3"]
    outside: str = eqx.field(static=True)

    def __init__(
        self, times: ArrayInput, quaternions: ArrayInput, rates: ArrayInput | None = None, outside: str = "error"
    ):
        if outside not in OUTSIDE:
            raise ValueError(f"outside must be {' or '.join(map(repr, OUTSIDE))}, but {outside!r} was given")
        self.outside = outside
        table = attitude_table(quaternions, "a table program")
        instants = as_seconds(times, from_first=True)
        dtype = shared_dtype(instants, table)
        self.times, self.quaternions = instants.astype(dtype), rotation.continuous(table.astype(dtype))
        _require_increasing(self.times, table.shape[0])
        distinct = _require_axes(self.times, self.quaternions)
        found = _spline_rates(self.times, self.quaternions) if rates is None else as_float(rates).astype(dtype)
        self.rates = found if distinct is None else xp.where(distinct, found, np.nan)
        if self.rates.shape != (table.shape[0], 3):
            raise ValueError(
                f"rates must have shape ({table.shape[0]}, 3), one row for each attitude, "
                f"but shape {self.rates.shape} was given"
            )
        require_finite(self.rates, "the rates of a table program")

    def __repr__(self) -> str:
        return shown(self, times="s", rates="rad/s")

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s] after the first attitude.

        **Raises:** ValueError for a time outside [0, duration], unless `outside` allows it.
        """
        t = one_instant(t).astype(self.times.dtype)
        if self.outside == "error":
            _require_within(self, t)
        return _attitude(self, t)

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The time [s] from the first to the last attitude."""
        return self.times[-1] - self.times[0]


@in_numpy_or_jit
def _attitude(program: TableProgram, t: Scalar) -> Attitude:
    last = program.times[-1] - program.times[0]
    beyond = (t < -SLACK * last) | (t > (1 + SLACK) * last)
    if program.outside == "error":
        at = _extended(program, xp.where(beyond, 0.0, t))
        return jax.tree.map(lambda x: xp.where(beyond, np.nan, x), at)
    if program.outside == "extrapolate":
        return _extended(program, t)
    at = _extended(program, xp.clip(t, 0.0, last))
    still = (t < 0) | (t > last)
    return Attitude(at.quaternion, xp.where(still, 0.0, at.rate), xp.where(still, 0.0, at.acceleration))


def _extended(program: TableProgram, t: Scalar) -> Attitude:
    """Return the attitude at `t` [s] with the first and the last polynomial outside the table."""
    starts, rates = program.times - program.times[0], program.rates
    piece = xp.sum(t >= starts[1:-1])
    start, vector = _rotation(program.quaternions[piece], program.quaternions[piece + 1])
    theta = spline.cubic(vector, starts[piece + 1] - starts[piece], rates[piece], rates[piece + 1])
    return _evaluate(start, theta, t - starts[piece])


def _rotation(start: Quat, end: Quat) -> tuple[Quat, Vec3]:
    """Return the unit quaternion of `start`, and the rotation vector [rad] from `start` to `end` in body axes."""
    start = quaternion.unit(start)
    return start, 2 * quaternion.log(quaternion.product(quaternion.conjugate(start), end))


def _evaluate(start: Quat, theta: Float[Array, "4 3"], t: Scalar) -> Attitude:
    """Return the attitude `t` seconds after `start`, from the coefficients (4, 3) of the cubic rotation vector θ."""
    value = theta[0] + t * (theta[1] + t * (theta[2] + t * theta[3]))
    slope = theta[1] + t * (2 * theta[2] + t * 3 * theta[3])
    second = 2 * theta[2] + t * 6 * theta[3]
    at = quaternion.product(start, rotation.from_rotation_vector(value))
    return Attitude(at, spline.rate(value, slope), spline.acceleration(value, slope, second))


def _spline_rates(times: Float[Array, " n"], quaternions: Float[Array, "n 4"]) -> Float[Array, "n 3"]:
    rates, converged = _knot_rates(times, quaternions)
    value = concrete(converged)
    if value is not None and not value:
        raise ValueError(
            "the iteration for a spline with continuous acceleration did not converge, because neighbouring attitudes "
            "are too far apart. Add attitudes between them, or pass rates."
        )
    return rates if value is not None else jnp.where(converged, rates, jnp.nan)


@in_numpy_or_jit
def _knot_rates(times: Float[Array, " n"], quaternions: Float[Array, "n 4"]) -> tuple[Float[Array, "n 3"], Flag]:
    """Return the rates at the attitudes, and whether the acceleration is continuous with these rates."""
    widths = xp.diff(times)
    _, rotations = _rotation(quaternions[:-1], quaternions[1:])
    rates, jump = spline.knot_rates(rotations, widths)
    return rates, jump <= _tolerance(rotations.dtype) * xp.max(abs(rotations / widths[:, None] ** 2))


def _tolerance(dtype: Any) -> float:
    """Return the largest acceptable jump of the acceleration of the spline, relative to angle/interval²."""
    return float(jnp.finfo(dtype).eps) ** 0.5


def _require_within(program: TableProgram, t: Scalar) -> None:
    """Raise a ValueError if a concrete time `t` [s] is outside the table."""
    value, times = concrete(t), concrete(program.times)
    if value is None or times is None:
        return
    last = float(times[-1] - times[0])
    if -SLACK * last <= float(value) <= (1 + SLACK) * last or np.isnan(value):
        return
    clock = f" (the table starts at {float(times[0]):.9g} s; the time of a program starts at 0)" if times[0] else ""
    raise ValueError(
        f"a table program lasts from 0 to {last:.9g} s, but it was evaluated at {float(value):.9g} s{clock}: pass "
        "outside='hold' to keep the attitudes at its ends, or outside='extrapolate' to continue its polynomials"
    )


def _require_axes(times: Float[Array, " n"], quaternions: Float[Array, "n 4"]) -> Flag | None:
    """Return whether no two neighbouring attitudes are a half turn apart, or None if that is known.

    **Raises:** ValueError if concrete attitudes are a half turn apart.
    """
    halves = _half_cosines(quaternions)
    values, instants = concrete(halves), concrete(times)
    if values is None:
        return xp.all(halves > HALF_TURN / 2)
    if (values > HALF_TURN / 2).all():
        return None
    k = int(np.argmin(values > HALF_TURN / 2))
    at = "" if instants is None else f", at {instants[k]:.9g} s and {instants[k + 1]:.9g} s,"
    raise ValueError(
        f"the attitudes {k} and {k + 1} of a table program{at} are a half turn apart, so the axis of the rotation "
        "between them is arbitrary: add an attitude between them"
    )


@of_arrays
def _half_cosines(quaternions: Float[Array, "n 4"]) -> Float[Array, " _"]:
    """Return |cos(Φ/2)| of the angles Φ between neighbouring attitudes."""
    units = quaternion.unit(quaternions)
    return abs(xp.sum(units[1:] * units[:-1], axis=-1))


def _require_increasing(times: Array, count: int) -> None:
    if times.shape != (count,):
        raise ValueError(
            f"a table program needs one time for each attitude, shape ({count},), but shape {times.shape} was given"
        )
    require_finite(times, "the times of a table program")
    values = concrete(times)
    if values is not None and not (np.diff(values) > 0).all():
        k = int((np.diff(values) <= 0).argmax()) + 1
        raise ValueError(
            f"the times of a table program must increase, but times[{k}] = {values[k]:.17g} s follows "
            f"times[{k - 1}] = {values[k - 1]:.17g} s"
        )
