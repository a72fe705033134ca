"""What stands between a command and the body: limits, and a command that is held between renewals."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Quat, Vec3

Sampling = Float[Array, ""] | Float[Array, " m"]


@storable
class Actuator(eqx.Module):
    """Limits and holds the physical part of a command; the virtual part is the computer's and has no limit.

    `limit` [rad/s², or rad/s of a rate law], None for none: a scalar with `saturation="norm"` shortens the vector and
    keeps its direction; with `"axis"` each component is clipped, by a scalar or by (3,) of its own. `sampling` [s]: a
    period, from the first instant on, or the renewal instants (m,) themselves; between two of them the command, also
    its virtual part, is held (zero-order hold). None: continuous. Given as instants, they may be traced and the
    closed loop is differentiable in them, exactly.

    **Raises:** ValueError for limits or periods that are not positive, instants that do not increase, another
    saturation, or a limit per axis under `"norm"`.
    """

    limit: Float[Array, "..."] | None
    saturation: str = eqx.field(static=True)
    sampling: Sampling | None

    def __init__(self, limit: ArrayInput | None = None, saturation: str = "norm", sampling: ArrayInput | None = None):
        if saturation not in ("norm", "axis"):
            raise ValueError(f"saturation must be 'norm' or 'axis', but {saturation!r} was given")
        self.saturation = saturation
        self.limit = None if limit is None else as_float(limit)
        if self.limit is not None:
            if self.limit.shape not in ((), (3,)) or (self.limit.shape and saturation == "norm"):
                raise ValueError(
                    f"a limit of shape {self.limit.shape} does not suit saturation={saturation!r}: give a scalar, or "
                    "(3,) with saturation='axis'"
                )
            require_positive(self.limit, "the actuator's limit", "rad/s²")
        self.sampling = sampling_instants(sampling)

    def __call__(self, command: Quat) -> Quat:
        """The command as the actuator gives it."""
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
    """A period or renewal instants as an array; ValueError for what is known to be wrong."""
    if sampling is None:
        return None
    with jax.ensure_compile_time_eval():  # a number stays one inside a trace, where it is counted by
        sampling = as_float(sampling)
    if sampling.ndim > 1 or sampling.size == 0:
        raise ValueError(f"sampling must be a period or a vector of instants [s], but its shape is {sampling.shape}")
    require_finite(sampling, "sampling")
    known = concrete(sampling)
    if sampling.ndim == 0:
        require_positive(sampling, "the sampling period", "s")
    elif known is not None and not (known[1:] > known[:-1]).all():
        raise ValueError("sampling instants must increase strictly")
    return sampling
