"""A program through given attitudes: the C² spline of rotations."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import as_float, concrete, one_instant, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Flag, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import common_dtype
from qtraj.motion.programs import rotation_spline as spline
from qtraj.motion.programs.euler_turn import attitude_table


@storable
class TableProgram(AbstractProgram):
    """The rotation spline through `quaternions` (n, 4) at `times` (n,) [s], n ≥ 2: rates and accelerations continuous.

    The attitudes may have any non-zero length and either sign, and are kept with continuous signs; the program is of
    unit length, starts with the sign of the first and is continuous. From each attitude to the next it takes the
    shorter way, so neighbours must be less than a half turn apart. The rates at both ends are the mean rates of the
    first and last interval. It agrees with SciPy's RotationSpline, whose own iteration stops at about 1e-9. Time is
    counted from the first of `times`; outside [0, duration] the first and last pieces go on.

    `rates` (n, 3) [rad/s], body axes, at the attitudes are found when the program is made and stored with it; given
    ones are taken as they are (then the acceleration may jump). Derivatives with respect to the table are exact
    through the second order.

    **Raises:** ValueError for fewer than two attitudes, times that do not increase, wrong shapes, values that are not
    finite, a zero quaternion, or attitudes too wild for a spline to be found.
    """

    times: Float[Array, " n"]
    quaternions: Float[Array, "n 4"]
    rates: Float[Array, "n 3"]

    def __init__(self, times: ArrayInput, quaternions: ArrayInput, rates: ArrayInput | None = None):
        table = attitude_table(quaternions, "a table program")
        instants = as_float(times)
        dtype = common_dtype(instants, table)
        self.times, self.quaternions = instants.astype(dtype), rotation.continuous(table.astype(dtype))
        _require_increasing(self.times, table.shape[0])
        self.rates = _found(self.times, self.quaternions) if rates is None else as_float(rates).astype(dtype)
        if self.rates.shape != (table.shape[0], 3):
            raise ValueError(
                f"rates must have shape ({table.shape[0]}, 3), one row for each attitude, "
                f"but shape {self.rates.shape} was given"
            )
        require_finite(self.rates, "the rates of a table program")

    def __call__(self, t: ScalarLike) -> Attitude:
        return _attitude(self, one_instant(t).astype(self.times.dtype))

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """From the first to the last of the times [s]."""
        return self.times[-1] - self.times[0]


@eqx.filter_jit
def _attitude(program: TableProgram, t: Scalar) -> Attitude:
    starts, rates = program.times - program.times[0], program.rates
    piece = jnp.sum(t >= starts[1:-1])
    start, turn = _turn(program.quaternions[piece], program.quaternions[piece + 1])
    theta = spline.cubic(turn, starts[piece + 1] - starts[piece], rates[piece], rates[piece + 1])
    return _along(start, theta, t - starts[piece])


def _turn(start: Quat, end: Quat) -> tuple[Quat, Vec3]:
    """The unit quaternion of the start, and the rotation vector from there to the end, in body axes [rad]."""
    start = quaternion.unit(start)
    return start, 2 * quaternion.log(quaternion.product(quaternion.conjugate(start), end))


def _along(start: Quat, theta: Float[Array, "4 3"], t: Scalar) -> Attitude:
    """The attitude on one piece, with the cubic θ evaluated `t` seconds after its start."""
    value = theta[0] + t * (theta[1] + t * (theta[2] + t * theta[3]))
    slope = theta[1] + t * (2 * theta[2] + t * 3 * theta[3])
    bend = 2 * theta[2] + t * 6 * theta[3]
    rate, acceleration = jax.jvp(spline.rate, (value, slope), (slope, bend))
    return Attitude(quaternion.product(start, rotation.from_rotation_vector(value)), rate, acceleration)


def _found(times: Float[Array, " n"], quaternions: Float[Array, "n 4"]) -> Float[Array, "n 3"]:
    rates, smooth = _knot_rates(times, quaternions)
    known = concrete(smooth)
    if known is not None and not known:
        raise ValueError(
            "no spline with continuous acceleration was found: neighbouring attitudes are too far apart. "
            "Give more attitudes between them, or give their rates."
        )
    return rates


@eqx.filter_jit
def _knot_rates(times: Float[Array, " n"], quaternions: Float[Array, "n 4"]) -> tuple[Float[Array, "n 3"], Flag]:
    """The rates at the attitudes, and whether the acceleration is continuous with them."""
    widths = jnp.diff(times)
    _, turns = jax.vmap(_turn)(quaternions[:-1], quaternions[1:])
    rates, jump = spline.knot_rates(turns, widths)
    return rates, jump <= _tolerance(turns.dtype) * jnp.max(jnp.abs(turns / widths[:, None] ** 2))


def _tolerance(dtype: Any) -> float:
    """The largest jump of acceleration, relative to turn/interval², of a spline that counts as found."""
    return float(jnp.finfo(dtype).eps) ** 0.5


def _require_increasing(times: Array, count: int) -> None:
    if times.shape != (count,):
        raise ValueError(
            f"a table program needs one time for each attitude, shape ({count},), but shape {times.shape} was given"
        )
    require_finite(times, "the times of a table program")
    known = concrete(times)
    if known is not None and not (np.diff(known) > 0).all():
        late = int((np.diff(known) <= 0).argmax()) + 1
        raise ValueError(
            f"the times of a table program must increase, but time {late} is {known[late]:.17g} s "
            f"after {known[late - 1]:.17g} s"
        )
