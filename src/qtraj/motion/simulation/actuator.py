"""Model an actuator, which can limit the command of the law and hold the command between samples."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import single_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3

Sampling = Float[Array, ""] | Float[Array, " m"]


@storable
class Actuator(eqx.Module):
    """An actuator, which can limit the physical part of a command and hold the command between samples.

    The virtual part of a command is not limited. `limit` [rad/s²; rad/s for a rate law]: None for no limit. With
    `saturation="norm"`, a scalar limits the magnitude of the vector without changing its direction. With `"axis"`, each
    component is clipped to the limit, a scalar or (3,) with one limit for each axis. `sampling` [s]: a period, counted
    from the first instant of the simulation, or the instants (m,) of new commands; the whole command is held between
    samples (zero-order hold). With None, the command is continuous. Instants may be traced; derivatives of the closed
    loop with respect to instants are exact. `time_constant` τ [s]: the actuator follows the limited command u with the
    lag ȧ = (u − a)/τ, and starts at the first command; None for no lag. a is the physical acceleration (the rate for a
    rate law), or the torques of a `RigidBody`. Between samples the lag is computed in closed form; with a continuous
    command, steps are at most about 3τ.

    **Raises:** ValueError for limits, periods or time constants that are not positive, instants that do not increase,
    an unknown `saturation`, or a limit of shape (3,) with `"norm"`.
    """

    limit: Float[Array, "..."] | None
    saturation: str = eqx.field(static=True)
    sampling: Sampling | None
    time_constant: Scalar | None

    def __init__(
        self,
        limit: ArrayInput | None = None,
        saturation: str = "norm",
        sampling: ArrayInput | None = None,
        time_constant: ArrayInput | None = None,
    ):
        if saturation not in ("norm", "axis"):
            raise ValueError(f"saturation must be 'norm' or 'axis', but {saturation!r} was given")
        self.saturation = saturation
        self.limit = None if limit is None else as_float(limit)
        if self.limit is not None:
            if self.limit.shape not in ((), (3,)):
                raise ValueError(
                    f"the actuator's limit must be a scalar or have shape (3,), but shape {self.limit.shape} was given"
                )
            if self.limit.ndim and saturation == "norm":
                raise ValueError("a limit for each axis requires saturation = 'axis', but 'norm' was given")
            require_positive(self.limit, "the actuator's limit", "rad/s², or rad/s for a rate law")
        self.sampling = sampling_instants(sampling)
        self.time_constant = None if time_constant is None else real_scalar(time_constant, "the time constant")
        if self.time_constant is not None:
            require_positive(self.time_constant, "the time constant", "s")

    def __repr__(self) -> str:
        return shown(self, sampling="s", time_constant="s")

    @single_arguments
    def __call__(self, command: Quat) -> Quat:
        """Return the `command` (4,) with its physical part limited."""
        if self.limit is None:
            return command
        return jnp.concatenate([command[:1], self._limited(command[1:], self.limit.astype(command.dtype))])

    def _limited(self, vector: Vec3, limit: Array) -> Vec3:
        if self.saturation == "axis":
            return jnp.clip(vector, -limit, limit)
        length = norm(vector)
        over = length > limit
        return vector * jnp.where(over, limit / jnp.where(over, length, 1.0), 1.0)


def sampling_instants(sampling: ArrayInput | None) -> Sampling | None:
    """Return a period or sampling instants as an array; raise a ValueError for invalid concrete values."""
    if sampling is None:
        return None
    with jax.ensure_compile_time_eval():  # a concrete period must stay concrete inside a trace
        sampling = as_float(sampling)
    if sampling.ndim > 1 or sampling.size == 0:
        raise ValueError(f"sampling must be a period or a vector of instants [s], but shape {sampling.shape} was given")
    require_finite(sampling, "sampling")
    values = concrete(sampling)
    if sampling.ndim == 0:
        require_positive(sampling, "the sampling period", "s")
    elif values is not None and not (values[1:] > values[:-1]).all():
        i = int((values[1:] <= values[:-1]).argmax())
        raise ValueError(
            f"sampling instants must increase strictly, but sampling[{i + 1}] = {values[i + 1]:.9g} s follows "
            f"sampling[{i}] = {values[i]:.9g} s"
        )
    return sampling
