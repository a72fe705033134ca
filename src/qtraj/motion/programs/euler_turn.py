"""Turns about a fixed axis from one attitude to another (Euler's theorem; paper C, (3.1)–(3.15))."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.vector import norm, unit
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_vector, require_finite
from qtraj.foundation.document import formerly, storable
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import common_dtype, require_axes
from qtraj.motion.profiles.profile import AbstractProfile, Profile

UNRESOLVED = 8
"""In machine epsilons [rad]: the quaternions of one attitude, normalised and multiplied, may differ by so much."""


@storable
class EulerTurn(AbstractProgram):
    """The shorter turn from `start_q` to `end_q` (4,), λ⁰ = λ_0∘(cos Φ(t)/2 + e sin Φ(t)/2), under a law for Φ(t).

    Both quaternions may have any non-zero length; the program starts at λ_0 = start_q/|start_q|. With a = λ̄_0∘λ_*, it
    ends at λ_* = end_q/|end_q| where a0 ≥ 0 and at −λ_* otherwise (`end` is the one); the same attitude. Value and
    gradient are finite for equal attitudes (a constant program) and for half turns, where either sense is as short:
    e is then along a_v. Rate and acceleration are Φ̇e and Φ̈e; `axis` gives e. Before its start and after its duration
    the program is at rest.

    **Raises:** ValueError for quaternions that are zero, not finite or of another shape, or a law that is none; and as
    the law for the angle.
    """

    start_q: Quat
    end_q: Quat
    law: AbstractProfile

    def __init__(self, start_q: ArrayInput, end_q: ArrayInput, law: AbstractProfile):
        start, end = (real_vector(q, name, 4) for q, name in ((start_q, "start_q"), (end_q, "end_q")))
        dtype = common_dtype(start, end)
        self.start_q, self.end_q, self.law = start.astype(dtype), end.astype(dtype), law
        _require_law(law)
        _require_attitudes(start[None], "start_q")
        _require_attitudes(end[None], "end_q")
        law.profile(self.angle)

    def __call__(self, t: ScalarLike) -> Attitude:
        vector = self.rotation_vector
        return _turned(quaternion.unit(self.start_q), vector, self.law.profile(norm(vector)), t)

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The duration of the turn [s]."""
        return self.profile.duration

    @property
    def profile(self) -> Profile:
        """Φ(t) and its derivatives: `profile.angle(t)`, `.rate(t)`, `.acceleration(t)`."""
        return self.law.profile(self.angle)

    @property
    def switches(self) -> Float[Array, " _"]:
        """The instants at which a piece of the law ends [s], the last at the duration: `jumps` for an integration."""
        return self.profile.switches

    @property
    def angle(self) -> Scalar:
        """The whole angle Φ [rad], from 0 to π."""
        return _length(self.start_q, self.end_q)

    @property
    def rotation_vector(self) -> Vec3:
        """Φe [rad], body axes."""
        return _shorter_turn(self.start_q, self.end_q)

    @property
    def end(self) -> Quat:
        """The unit quaternion at which the program ends, ±end_q/|end_q|."""
        return quaternion.product(quaternion.unit(self.start_q), rotation.from_rotation_vector(self.rotation_vector))

    def axis(self, axes: str = "body") -> Vec3:
        """The unit vector e of the turn in body axes, or in inertial axes; body x for equal attitudes.

        **Raises:** ValueError for other axes.
        """
        require_axes(axes)
        e = _direction(self.rotation_vector)
        return e if axes == "body" else quaternion.rotate(self.start_q, e)


@formerly("TurnChain")
@storable
class SlewSequence(AbstractProgram):
    """Euler turns through several attitudes (n, 4), n ≥ 2, at rest at each.

    Each turn is the shorter one and follows `law`. The program starts at the first quaternion (normalised) and passes
    the others with the sign nearest to the one before; `attitudes` is kept so. At an attitude the turn that leaves it
    counts.

    **Raises:** ValueError for fewer than two attitudes, quaternions that are zero or not finite, a law that does not
    rest at both ends, or a duration in which the law cannot turn the largest of the angles.
    """

    attitudes: Float[Array, "n 4"]
    law: AbstractProfile

    def __init__(self, attitudes: ArrayInput, law: AbstractProfile):
        self.attitudes = rotation.continuous(attitude_table(attitudes, "a chain of turns"))
        self.law = law
        _require_law(law)
        if not law.profile(jnp.max(self.angles)).proportional:
            raise ValueError("a chain of turns rests at each attitude: leave out start_rate and end_rate of the law")

    def __call__(self, t: ScalarLike) -> Attitude:
        times = self.times
        t = one_instant(t).astype(times.dtype)
        turn = jnp.sum(t >= times[1:-1])
        start, vector = self.attitudes[turn], _shorter_turn(self.attitudes[turn], self.attitudes[turn + 1])
        return _turned(quaternion.unit(start), vector, self.law.profile(norm(vector)), t - times[turn])

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The sum of the turns' durations [s]."""
        return self.times[-1]

    @property
    def times(self) -> Float[Array, " n"]:
        """The instants at which the program is at each of its attitudes [s]."""
        return _arrivals(self.law, self.angles)

    @property
    def switches(self) -> Float[Array, " _"]:
        """The instants at which a piece of a turn ends [s], in order: `jumps` for an integration.

        Some may be the same: where a piece, or a whole turn, takes no time.
        """
        return _switches(self.law, self.angles)

    @property
    def angles(self) -> Float[Array, " _"]:
        """The angle of each turn [rad], from 0 to π."""
        return jax.vmap(_length)(self.attitudes[:-1], self.attitudes[1:])


def attitude_table(values: ArrayInput, name: str) -> Float[Array, "n 4"]:
    """Two or more quaternions (n, 4), none of them zero (ValueError otherwise)."""
    table = as_float(values)
    if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] != 4:
        raise ValueError(f"{name} needs at least two quaternions, shape (n, 4), but shape {table.shape} was given")
    require_finite(table, f"the attitudes of {name}")
    _require_attitudes(table, name)
    return table


def _require_law(law: AbstractProfile) -> None:
    if not isinstance(law, AbstractProfile):
        raise ValueError(f"a law such as TimeOptimal(max_rate, max_acceleration) was expected, but {law!r} was given")


def _require_attitudes(quaternions: Float[Array, "n 4"], name: str) -> None:
    known = concrete(quaternions)
    if known is not None and not known.any(axis=1).all():
        zero = int((~known.any(axis=1)).argmax())
        raise ValueError(f"{name}: quaternion {zero} is zero, which is no attitude")


@jax.jit
def _shorter_turn(start: Quat, end: Quat) -> Vec3:
    """Φe in body axes: smooth at Φ = 0; where a0 = 0, e is along a_v."""
    a = quaternion.product(quaternion.conjugate(quaternion.unit(start)), quaternion.unit(end))
    vector = 2 * quaternion.log(jnp.where(a[0] < 0, -a, a))
    # Equal attitudes: round-off is no turn, which would take time. The derivative stays that of a turn.
    round_off = norm(vector) <= UNRESOLVED * float(jnp.finfo(vector.dtype).eps)
    return vector - stop_gradient(jnp.where(round_off, vector, 0.0))


@jax.jit
def _length(start: Quat, end: Quat) -> Scalar:
    return norm(_shorter_turn(start, end))


@eqx.filter_jit
def _arrivals(law: AbstractProfile, angles: Float[Array, " m"]) -> Float[Array, " m+1"]:
    """When turns by these angles, one after the other, are over [s]; 0 first."""
    durations = jax.vmap(lambda angle: law.profile(angle).duration)(angles)
    return jnp.concatenate([jnp.zeros_like(durations, shape=1), jnp.cumsum(durations)])


@eqx.filter_jit
def _switches(law: AbstractProfile, angles: Float[Array, " m"]) -> Float[Array, " _"]:
    """When pieces of turns by these angles, one after the other, end [s]."""
    within = jax.vmap(lambda angle: law.profile(angle).switches)(angles)
    return (_arrivals(law, angles)[:-1, None] + within).ravel()


def _direction(vector: Vec3) -> Vec3:
    return unit(vector, jnp.zeros_like(vector).at[0].set(1.0))


@eqx.filter_jit
def _turned(start: Quat, vector: Vec3, profile: Profile, t: ScalarLike) -> Attitude:
    # A resting profile is a fraction of the whole turn, so that everything stays smooth in a vanishing vector.
    along = vector if profile.proportional else _direction(vector)
    angle, rate, acceleration = profile.shape(t, 2)
    return Attitude(
        quaternion=quaternion.product(start, rotation.from_rotation_vector(angle * along)),
        rate=rate * along,
        acceleration=acceleration * along,
    )
