"""Define eigenaxis slews, rotations about a fixed axis (Euler's theorem; paper C, (3.1)–(3.15))."""

from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_scalar, real_vector, require_finite
from qtraj.foundation.document import formerly, storable
from qtraj.foundation.namespace import in_numpy_or_jit, mapped, of_arrays, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.checks import require_axes, require_precise_angle, shared_dtype
from qtraj.motion.profiles.profile import END_STATES, AbstractProfile, Profile
from qtraj.motion.programs.eigenaxis import (
    attitude_about,
    attitude_after,
    attitude_between,
    axis_of,
    length,
    require_end,
    rotation_about,
    shorter_rotation,
    size,
    turned,
)
from qtraj.motion.programs.program_sequence import ProgramSequence


@storable
class EulerTurn(AbstractProgram):
    """An eigenaxis slew λ⁰ = λ_0∘(cos(Φ(t)/2) + e sin(Φ(t)/2)), the shorter rotation from `start_q` to `end_q` (4,).

    `law` is the motion profile that determines the angle Φ(t), such as `TimeOptimal` or `Quintic`. The quaternions need
    not be normalised. The program starts at λ_0 = start_q/|start_q|. With λ_* = end_q/|end_q| and a = λ̄_0∘λ_*, the
    program ends at λ_* if a0 ≥ 0 and otherwise at −λ_*, which is the same attitude; `end` is the final quaternion. Rate
    and acceleration are Φ̇e and Φ̈e; `axis` returns the unit vector e. The program is at rest before the start and
    after the end of the slew.

    The program and its gradient are finite for equal attitudes, for which the program is constant. They are also finite
    for half turns. Both senses of rotation are then equally short, and e has the direction of a_v, the vector part of
    a.

    `about` creates slews of any angle, such as the longer way and whole turns. The field `vector` is then their
    rotation vector (3,) [rad] in body axes, from `start_q` to `end_q`; it is None for the shorter rotation.

    **Raises:** ValueError for quaternions that are zero, not finite or of another shape, for a `vector` that does not
    lead from `start_q` to `end_q`, for a `law` that is not a motion profile, and if the slew is not possible with this
    profile.
    """

    start_q: Quat
    end_q: Quat
    law: AbstractProfile
    vector: Vec3 | None

    def __init__(
        self, start_q: ArrayInput, end_q: ArrayInput, law: "AbstractProfile", vector: ArrayInput | None = None
    ):
        start, end = (real_vector(q, name, 4) for q, name in ((start_q, "start_q"), (end_q, "end_q")))
        dtype = shared_dtype(start, end)
        self.start_q, self.end_q, self.law = start.astype(dtype), end.astype(dtype), law
        _require_profile(law)
        _require_attitudes(start[None], "start_q")
        _require_attitudes(end[None], "end_q")
        self.vector = None if vector is None else real_vector(vector, "vector", 3).astype(dtype)
        if self.vector is not None:
            require_end(self.start_q, self.vector, self.end_q)
        law.profile(self.angle, unit="rad")

    @classmethod
    def about(
        cls, axis: ArrayInput, angle: ArrayInput, start_q: ArrayInput, law: "AbstractProfile", axes: str = "body"
    ) -> "EulerTurn":
        """Return the slew from `start_q` (4,) about `axis` (3,) by any `angle` [rad], also of several whole turns.

        `axis` need not be a unit vector; it is in `axes`, "body" or "inertial". A negative angle turns the other way.
        `end_q` is then the continuous final quaternion, so a whole turn ends at −λ_0.

        **Raises:** ValueError for an axis that is zero, values that are not finite or of another shape, an angle so
        large that its rounding error exceeds 0.01 rad, unknown `axes`, and in the same cases as `EulerTurn`.

        Example:
            >>> import qtraj as qt
            >>> roll = EulerTurn.about([1, 0, 0], 3 * np.pi, [1, 0, 0, 0], qt.Quintic(duration=10.0))
            >>> print(f"{float(roll.angle):.4f} rad, λ1 = {roll.end[1]:.4f}")
            9.4248 rad, λ1 = -1.0000
        """
        require_axes(axes)
        e, total = real_vector(axis, "axis", 3), real_scalar(angle, "the angle of a slew")
        require_finite(total, "the angle of a slew")
        require_precise_angle(total, "the angle of a slew")
        start = real_vector(start_q, "start_q", 4)
        _require_attitudes(start[None], "start_q")
        value = concrete(e)
        if value is not None and not value.any():
            raise ValueError("axis must not be zero: pass a vector along the axis of the slew")
        vector = rotation_about(e if axes == "body" else quaternion.rotate(quaternion.conjugate(start), e), total)
        return cls(start, turned(start, vector), law, vector)

    def __repr__(self) -> str:
        return shown(self)

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        t = one_instant(t)
        if self.vector is not None:
            return attitude_about(self.start_q, self.vector, self.profile, t)
        return attitude_between(self.start_q, self.end_q, self.law.profile(self.angle), t)

    def prepared(self) -> "PreparedSlew":
        """Return the slew with its start, its rotation vector and its profile already computed."""
        start = quaternion.unit(self.start_q)
        return PreparedSlew(start, self.rotation_vector, self.profile)  # pyright: ignore[reportCallIssue]

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The duration of the slew [s]."""
        return self.profile.duration

    @property
    def profile(self) -> Profile:
        """Φ(t) and its derivatives: `profile.angle(t)`, `.rate(t)`, `.acceleration(t)`."""
        return self.law.profile(self.angle)

    @property
    def switches(self) -> Float[Array, " _"]:
        """The end times [s] of the segments of the profile, to be passed as `jumps` to an integration."""
        return self.profile.switches

    @property
    def angle(self) -> Scalar:
        """The angle of the slew [rad], from 0 to π; any positive angle for a slew that `about` created."""
        return length(self.start_q, self.end_q) if self.vector is None else size(self.vector)

    @property
    def rotation_vector(self) -> Vec3:
        """The rotation vector of the slew, angle times axis [rad], body axes."""
        return shorter_rotation(self.start_q, self.end_q) if self.vector is None else self.vector

    @property
    def end(self) -> Quat:
        """The unit quaternion at the end of the program, ±end_q/|end_q|."""
        return turned(self.start_q, self.rotation_vector)

    def axis(self, axes: str = "body") -> Vec3:
        """Return the unit vector e of the slew in `axes`, "body" or "inertial"; for equal attitudes, the body x axis.

        **Raises:** ValueError if `axes` is neither "body" nor "inertial".
        """
        require_axes(axes)
        e = axis_of(self.rotation_vector)
        return e if axes == "body" else quaternion.rotate(self.start_q, e)


class PreparedSlew(AbstractProgram):
    """An `EulerTurn` for repeated evaluation: the unit quaternion at its start, its rotation vector and its profile."""

    start: Quat
    rotation_vector: Vec3
    profile: Profile

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        return attitude_after(self.start, self.rotation_vector, self.profile, one_instant(t))

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The duration of the slew [s]."""
        return self.profile.duration


@formerly("TurnChain")
@storable
class SlewSequence(AbstractProgram):
    """Eigenaxis slews through several attitudes (n, 4), n ≥ 2, at rest at each attitude.

    Each slew is the shorter rotation to the next attitude and follows the motion profile `law`. The program starts at
    the first quaternion, after normalisation. The field `attitudes` contains the quaternions with continuous signs:
    the scalar product of two consecutive quaternions is not negative. At the instant between two slews, the values of
    the second slew are returned.

    **Raises:** ValueError for fewer than two attitudes, for quaternions that are zero, not finite or of another shape,
    for a profile with `start_rate` or `end_rate`, or for a fixed duration that is too short for the largest angle.
    """

    attitudes: Float[Array, "n 4"]
    law: AbstractProfile

    def __init__(self, attitudes: ArrayInput, law: "AbstractProfile"):
        self.attitudes = rotation.continuous(attitude_table(attitudes, "a slew sequence"))
        self.law = law
        _require_profile(law)
        if not law.profile(_largest(self.angles), unit="rad").proportional:
            raise ValueError(
                "a slew sequence is at rest at each attitude, but the profile has states at its ends: omit "
                f"{' and '.join(name for name in END_STATES if getattr(law, name, None) is not None)}"
            )

    def __repr__(self) -> str:
        return shown(self)

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        start, end, elapsed = _part(self.attitudes, self.times, one_instant(t))
        return attitude_between(start, end, self.law.profile(length(start, end)), elapsed)

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The sum [s] of the durations of all slews."""
        return self.times[-1]

    @property
    def times(self) -> Float[Array, " n"]:
        """The instants [s] at which the program reaches its attitudes, starting with 0."""
        return _arrivals(self.law, self.angles)

    @property
    def switches(self) -> Float[Array, " _"]:
        """The end times [s] of the segments of all profiles, ascending, to be passed as `jumps` to an integration.

        Instants are repeated if a segment, or a whole slew, has zero duration.
        """
        return _switches(self.law, self.angles)

    @property
    def angles(self) -> Float[Array, " _"]:
        """The angle of each slew [rad], from 0 to π."""
        return _lengths(self.attitudes)


def ends_at_rest(program: AbstractProgram) -> bool:
    """Return whether a program ends with a slew to rest, so that its attitude is constant after its duration."""
    if isinstance(program, ProgramSequence):
        return ends_at_rest(program.programs[-1])
    if isinstance(program, EulerTurn):
        return float(program.profile.end_rate) == 0
    return isinstance(program, SlewSequence)


def attitude_table(values: ArrayInput, name: str) -> Float[Array, "n 4"]:
    """Return `values` as an array (n, 4) of two or more finite, non-zero quaternions; raise a ValueError otherwise."""
    table = as_float(values)
    if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] != 4:
        raise ValueError(f"{name} needs at least two quaternions, shape (n, 4), but shape {table.shape} was given")
    require_finite(table, f"the attitudes of {name}")
    _require_attitudes(table, name)
    return table


def _require_profile(law: AbstractProfile) -> None:
    if not isinstance(law, AbstractProfile):
        raise ValueError(
            f"a motion profile such as TimeOptimal(max_rate, max_acceleration) was expected, but {law!r} was given"
        )


def _require_attitudes(quaternions: Float[Array, "n 4"], name: str) -> None:
    values = concrete(quaternions)
    if values is not None and not values.any(axis=1).all():
        zero = int((~values.any(axis=1)).argmax())
        raise ValueError(f"{name}: quaternion {zero} is zero, which does not represent an attitude")


@of_arrays
def _lengths(attitudes: Float[Array, "n 4"]) -> Float[Array, " _"]:
    return length(attitudes[:-1], attitudes[1:])


@of_arrays
def _largest(angles: Float[Array, " _"]) -> Scalar:
    return xp.max(angles)


@of_arrays
def _part(attitudes: Float[Array, "n 4"], times: Float[Array, " n"], t: Scalar) -> tuple[Quat, Quat, Scalar]:
    """Return the attitudes at the start and the end of the slew at `t` [s], and the time [s] since its start."""
    t = t.astype(times.dtype)
    slew = xp.sum(t >= times[1:-1])
    return attitudes[slew], attitudes[slew + 1], t - times[slew]


@in_numpy_or_jit
def _arrivals(law: AbstractProfile, angles: Float[Array, " m"]) -> Float[Array, " m+1"]:
    """Return 0 and the end times [s] of consecutive slews of the `angles` [rad]."""
    durations = mapped(lambda angle: law.profile(angle).duration)(angles)
    return xp.concatenate([xp.zeros_like(durations[:1]), xp.cumsum(durations)])


@in_numpy_or_jit
def _switches(law: AbstractProfile, angles: Float[Array, " m"]) -> Float[Array, " _"]:
    """Return the end times [s] of all segments of consecutive slews of the `angles` [rad]."""
    within = mapped(lambda angle: law.profile(angle).switches)(angles)
    return xp.sort((_arrivals(law, angles)[:-1, None] + within).ravel())  # round-off may exchange equal instants
