"""Define the spiral-helix r(t) = ρ(i cos φ + j sin φ) + k h of paper S.

The radius ρ, the azimuth φ and the height h are polynomials in t; i, j and k are the axes of the placement.
"""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.foundation.arrays import as_float, one_instant, real_scalar, require_finite, require_positive
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.methods import method
from qtraj.foundation.namespace import in_numpy, is_host, of_arrays, xp
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.seconds import seconds
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike
from qtraj.path import boundary_problem as problem
from qtraj.path.boundary import BoundaryState, require_states
from qtraj.path.components import rotated_z
from qtraj.path.frame_components import filled
from qtraj.path.hodograph import AbstractHodograph, require_order
from qtraj.path.moving_basis import MovingPolynomials, in_moving_basis
from qtraj.path.placement import Placement


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    """Remove the residual, which older documents of fitted paths contained, from the fields of a document."""
    return {name: value for name, value in fields.items() if name != "residual"}


@reads_older(_from_older)
@storable
class SpiralHelix(AbstractHodograph, AbstractResult):
    """A spiral about an axis, with a variable height along the axis.

    `radius`, `angle` and `height` are ascending coefficients in t [s] of radius ρ [m], azimuth φ [rad] and height h
    [m], of any degree. `duration` is in s. The axis is the world's z axis unless a `placement` is given. Outside [0,
    duration] the polynomials are extrapolated. `mismatch` is the relative difference of the angular rates V_φ/ρ
    (azimuthal velocity divided by radius) of the two states of `from_boundary`; it is infinite if no solution exists.

    **Raises:** ValueError for coefficients that are not a finite vector, or a duration that is not positive.
    """

    radius: Float[Array, " n_radius"]
    angle: Float[Array, " n_angle"]
    height: Float[Array, " n_height"]
    duration: Scalar
    placement: Placement | None
    mismatch: Scalar
    supports_numpy: ClassVar[bool] = True

    def __init__(
        self,
        radius: ArrayInput,
        angle: ArrayInput,
        height: ArrayInput,
        duration: ArrayInput,
        placement: "Placement | None" = None,
        mismatch: ArrayInput = 0.0,
    ):
        self.radius = _coefficients(radius, "radius")
        self.angle = _coefficients(angle, "angle")
        self.height = _coefficients(height, "height")
        self.duration = real_scalar(seconds(duration), "the duration of a spiral-helix")
        self.placement = placement
        own = as_float(mismatch)
        self.mismatch = own.astype(self.duration.dtype) if is_host(own) else own
        require_positive(self.duration, "the duration of a spiral-helix", "s")

    def record(self) -> Record:
        """Return the exact path: coefficients over `radius_power`, `angle_power` and `height_power`.

        To sample the path, call `qtraj.evaluate(path, times).to_xarray()`.
        """
        variables = {"duration": Quantity(self.duration, "s", "duration of the path")}
        for name, unit, symbol in (("radius", "m", "ρ"), ("angle", "rad", "φ"), ("height", "m", "h")):
            meaning = f"coefficients of {symbol}(t); the coefficient of t^k is in {unit} s^-k"
            variables[name] = Quantity(getattr(self, name), unit, meaning, (f"{name}_power",))
        if self.placement is not None:
            variables["origin"] = Quantity(self.placement.origin, "m", "a point on the axis, in world axes", ("world",))
            meaning = "quaternion from the path's axes to world axes, not normalised"
            variables["orientation"] = Quantity(self.placement.orientation, "1", meaning, ("component",))
        first, last = (extent(radius, "m") for radius in _ends(self.radius, self.duration))
        turn, climb = (np.diff(_ends(x, self.duration), axis=0) for x in (self.angle, self.height))
        change = f"turn {extent(np.rad2deg(turn))}°, climb {extent(climb, 'm')} in {extent(self.duration, 's')}"
        summary = f"{batch_prefix(self.duration.shape)}radius {first} to {last}, {change}"
        return Record(summary, variables, attributes={"frame": "world"})

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return r and its time derivatives up to `order` at one instant, world axes; row k in [m s^-k]."""
        require_order(order)
        return _derivatives(self, one_instant(t), order)

    def sampled(self, t: Float[Array, " n"], order: int) -> list[Float[Array, "n 3"]]:
        """Return r and its time derivatives up to `order`, each (n, 3), at instants `t` (n,), in world axes."""
        polynomials = method(self, "polynomials")()
        x, y, z, angle = method(polynomials, "series")(t, order)
        cos, sin, zero = xp.cos(angle[0]), xp.sin(angle[0]), xp.zeros_like(angle[0])
        rows = [rotated_z(filled(row, zero), cos, sin) for row in in_moving_basis(x, y, z, angle)]
        world = [xp.stack(row, axis=-1) for row in rows]
        if self.placement is None:
            return world
        to_world = method(self.placement, "to_world")
        world = [to_world(row) for row in world]
        return [
            world[0] + self.placement.origin.astype(world[0].dtype).reshape((1,) * angle[0].ndim + (3,)),
            *world[1:],
        ]

    def rotating_derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return r and its derivatives at `t` in radial, azimuthal and axial components; row k in [m s^-k].

        r is relative to the placement's origin.
        """
        return _rotating(self, one_instant(t), order)

    def polynomials(self) -> MovingPolynomials:
        """Return the coefficients of the components radius, 0 and height in the rotating basis, and of its angle."""
        return MovingPolynomials(self.radius, None, self.height, self.angle, self.placement)

    @property
    def turn(self) -> Scalar:
        """The signed angle of rotation [rad] about the axis from start to end."""
        return _turn(self.angle, self.duration)

    @classmethod
    def from_boundary(
        cls, start: BoundaryState, end: BoundaryState, turns: int = 0, placement: Placement | None = None
    ) -> "SpiralHelix":
        """Compute the spiral-helix with a constant rate φ̇ and cubic ρ and h through two boundary states (paper S).

        ρ is the radius, φ the azimuth, h the height, and V_φ the azimuthal velocity. The turn has the sign of V_φ at
        the start. Its magnitude is `turns` whole turns plus an angle in [0, 2π). The duration is turn·ρ/V_φ. With
        azimuth and height measured from the start, there are ten boundary values for nine unknowns, so V_φ/ρ must be
        the same at both ends.

        **Raises:** ValueError if the relative difference of V_φ/ρ between the ends exceeds 1e-9 (in float32, 16 machine
        epsilons), a radius is zero, V_φ is zero at both ends, the azimuths are equal with `turns=0`, `turns` is not an
        integer ≥ 0, or an acceleration is given. Traced values are not checked; check the `mismatch` of the path
        instead.
        """
        require_states(start, end)
        eps = float(np.finfo(np.result_type(start.position.dtype, end.position.dtype)).eps)
        return cls(*problem.uniform(start, end, turns, placement, eps))

    @classmethod
    def hermite(
        cls,
        start: BoundaryState,
        end: BoundaryState,
        duration: ArrayInput,
        turns: int = 0,
        placement: Placement | None = None,
    ) -> "SpiralHelix":
        """Compute the spiral-helix with a given `duration` [s] and a polynomial angle that satisfies all boundary data.

        Radius, azimuth and height are cubics, or quintics if both states contain an acceleration. The turn is in (−π,
        π] plus `turns`, a signed number of whole turns.

        **Raises:** ValueError if the duration is not positive, a state lies on the axis, `turns` is not an integer, or
        only one state contains an acceleration.
        """
        require_states(start, end)
        duration = real_scalar(seconds(duration), "the duration of a spiral-helix")
        require_positive(duration, "the duration of a spiral-helix", "s")
        return cls(*problem.hermite(start, end, duration, turns, placement), duration, placement)

    @classmethod
    def between(cls, start: BoundaryState, end: BoundaryState, duration: ArrayInput, turns: int = 0) -> "SpiralHelix":
        """Compute the path of `hermite` about the vertical axis on which the horizontal normals of the velocities meet.

        **Raises:** ValueError if the horizontal velocities are parallel or zero, because then no such axis exists.
        """
        require_states(start, end)
        axis = problem.axis_between(start, end)
        return cls.hermite(start, end, duration, turns, axis)


@in_numpy
def _derivatives(path: SpiralHelix, t: Scalar, order: int) -> Float[Array, "{order}+1 3"]:
    return xp.stack(method(path, "sampled")(t, order))


@in_numpy
def _rotating(path: SpiralHelix, t: Scalar, order: int) -> Float[Array, "{order}+1 3"]:
    rows = path.polynomials().components(t, order)
    return xp.stack([xp.stack([xp.asarray(x, path.duration.dtype) for x in row]) for row in rows])


def _ends(coefficients: Array, duration: Array) -> np.ndarray:
    """Return the values of polynomials (*batch, n) at time 0 and at the durations (*batch), in this order."""
    c, t = np.asarray(coefficients), np.asarray(duration)
    powers = t[..., None] ** np.arange(c.shape[-1])
    return np.stack([c[..., 0], np.sum(c * powers, axis=-1)])


@of_arrays
def _turn(angle: Float[Array, " n"], duration: Scalar) -> Scalar:
    return polynomial.evaluate(angle, duration) - angle[0]


def _coefficients(values: ArrayInput, name: str) -> Float[Array, " n"]:
    try:
        coefficients = as_float(values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the {name} of a spiral-helix must be numbers, but {values!r} was given") from error
    if coefficients.ndim != 1 or coefficients.shape[0] == 0:
        raise ValueError(
            f"the {name} of a spiral-helix must be a vector of ascending polynomial coefficients, "
            f"but an array of shape {coefficients.shape} was given. Build a batch of paths with jax.vmap."
        )
    require_finite(coefficients, f"the {name} of a spiral-helix")
    return coefficients
