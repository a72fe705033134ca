"""Solve the attitude kinematics 2λ̇ = λ∘ω(t) with diffrax, by a Magnus solver that keeps |λ| constant.

For quaternions at given instants, `qtraj.propagate` is faster. Use this module for events, for dense output, and in
code that already uses diffrax. No other module of qtraj imports this module, so diffrax is imported only on demand.
"""

import math
from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.types import Quat, Scalar, ScalarLike
from qtraj.motion.checks import require_axes
from qtraj.motion.propagation.lagrange import lagrange
from qtraj.motion.propagation.magnus import sixth_order

_GAUSS = (0.5 - math.sqrt(15) / 10, 0.5, 0.5 + math.sqrt(15) / 10)
_KNOTS = (0.0, *_GAUSS, 1.0)
_WEIGHTS = (0.0, 5 / 18, 8 / 18, 5 / 18, 0.0)
_SIMPSON = (1 / 6, 0.0, 4 / 6, 0.0, 1 / 6)


class AttitudeTerm(diffrax.AbstractTerm):
    """The diffrax term of 2λ̇ = λ∘ω(t) in body axes, or of 2λ̇ = ω(t)∘λ for `axes="inertial"`.

    `omega(t)` [rad/s] has shape (3,), or (4,) with the scalar part first. For gradients with respect to its parameters,
    `omega` must be an equinox Module. The term works with `QuaternionMagnus` and any other diffrax solver:

        term = AttitudeTerm(omega)
        controller = diffrax.PIDController(rtol=1e-9, atol=1e-9)
        diffrax.diffeqsolve(term, QuaternionMagnus(), t0, t1, None, q0, stepsize_controller=controller)

    The `atol` of diffrax is an absolute tolerance, so multiply it by |q0|.

    **Raises:** ValueError if `axes` is neither "body" nor "inertial".
    """

    omega: Callable[..., Any]
    axes: str = eqx.field(static=True, default="body")

    def __check_init__(self):
        require_axes(self.axes)

    def vf(self, t: ScalarLike, y: Quat, args: Any) -> Quat:
        """Return λ̇ [1/s] at the time `t` [s] and the quaternion `y`."""
        return quaternion.derivative(y, jnp.asarray(self.omega(t), y.dtype), self.axes)

    def contr(self, t0: Any, t1: Any, **kwargs: Any) -> tuple[Any, Any]:
        """Return t1 − t0 [s] twice; for inertial axes, the second number has the opposite sign.

        A solver can only call the methods of its term; the sign of the second number tells the solver which axes are
        used.
        """
        return t1 - t0, (t1 - t0 if self.axes == "body" else t0 - t1)

    def prod(self, vf: Quat, control: tuple[Any, Any]) -> Quat:
        """Return the product of λ̇ and the first number of `control`, the time difference [s]."""
        return vf * jnp.asarray(control[0], vf.dtype)


class QuaternionMagnus(diffrax.AbstractAdaptiveSolver):
    """The Magnus expansion of order 6 as a diffrax solver for an `AttitudeTerm`; |λ| is constant to round-off.

    Each step evaluates the rate four times. The error estimate has order 4. It uses the embedded expansion of order 4
    for the commutator terms, and Simpson's rule for the integral of the rate. Dense output has order 5.
    `diffrax.BacksolveAdjoint` is not supported.
    """

    term_structure: ClassVar[Any] = AttitudeTerm
    interpolation_cls: ClassVar[Any] = property(
        lambda self: AttitudeInterpolation, doc="The dense output within a step: `AttitudeInterpolation`."
    )

    def order(self, terms: Any) -> int:
        """Return the order of the solution, 6."""
        return 6

    def error_order(self, terms: Any) -> int:
        """Return the order of the local error of the embedded method, 5."""
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: Quat, args: Any) -> Quat:
        """Return the solver state, which is the rate at `t0`; the first step reuses it."""
        return _rate(terms, t0, y0, args)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: Quat, args: Any, solver_state: Quat, made_jump: Any
    ) -> tuple[Quat, Quat, dict[str, Any], Quat, Any]:
        """Compute one step from `t0` to `t1`.

        Return λ, its error estimate, the data for dense output, the rate at `t1`, and the result code of diffrax.
        """
        h, signed = (jnp.asarray(x, y0.dtype) for x in terms.contr(t0, t1))
        side = jnp.sign(h) * jnp.sign(signed)
        first = jax.lax.cond(made_jump, lambda: _rate(terms, t0, y0, args), lambda: solver_state)
        later = jnp.stack([t0 + c * (t1 - t0) for c in _KNOTS[1:-1]] + [t1])
        others = jax.vmap(lambda t: _rate(terms, t, y0, args))(later)
        rates = jnp.concatenate([first[None], others]).at[:, 1:].multiply(side)
        end, error = _magnus_step(_body_form(y0, side), rates, h)
        dense_info = {"y0": y0, "rates": rates, "h": h, "side": side}
        return _body_form(end, side), _body_form(error, side), dense_info, others[-1], diffrax.RESULTS.successful

    def func(self, terms: Any, t0: Any, y0: Quat, args: Any) -> Quat:
        """Return λ̇ [1/s]."""
        return terms.vf(t0, y0, args)


class AttitudeInterpolation(diffrax.AbstractLocalInterpolation):
    """The interpolation of λ within a step, by the Magnus expansion from the start of the step to the instant.

    The rate is interpolated by the quartic through the five rates of the step. `rates` (5, 4) refer to the body form
    (see `_body_form`). `h` [s] is negative if time decreases. `side` is 1 for body axes and −1 for inertial axes.
    """

    t0: Any
    t1: Any
    y0: Quat
    rates: Float[Array, "5 4"]
    h: Scalar
    side: Scalar

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Quat:
        """Return λ at `t0`, or the change of λ from `t0` to `t1` if `t1` is not None."""
        if t1 is not None:
            return self.evaluate(t1) - self.evaluate(t0)
        whole = jnp.asarray(self.t1 - self.t0, self.y0.dtype)
        fraction = jnp.where(
            whole == 0, 0.0, jnp.asarray(t0 - self.t0, whole.dtype) / jnp.where(whole == 0, 1.0, whole)
        )
        knots = jnp.asarray(_KNOTS, whole.dtype)
        rates = jax.vmap(lambda c: lagrange(c * fraction, knots) @ self.rates)(knots)
        return _body_form(_magnus_step(_body_form(self.y0, self.side), rates, fraction * self.h)[0], self.side)


def _rate(terms: Any, t: Any, y: Quat, args: Any) -> Quat:
    """Return ω(t) (4,) [rad/s], scalar part first, in the axes of the term; ω is equal to 2λ̇ at λ = 1."""
    return 2 * terms.vf(t, jnp.zeros_like(y).at[0].set(1.0), args)


def _magnus_step(start: Quat, rates: Float[Array, "5 4"], h: Scalar) -> tuple[Quat, Quat]:
    """Return λ after a step in body axes, and the error estimate of λ, from the rates at `_KNOTS`."""
    weights = jnp.asarray(_WEIGHTS, h.dtype)
    vector, embedded = sixth_order(rates[1:4, 1:], h)
    check = h * ((weights - jnp.asarray(_SIMPSON, h.dtype)) @ rates)
    end = jnp.exp(0.5 * h * (weights @ rates[:, 0])) * quaternion.product(start, rotation.from_rotation_vector(vector))
    return end, 0.5 * quaternion.product(end, check.at[1:].add(vector - embedded))


def _body_form(q: Quat, side: Scalar) -> Quat:
    """Return q for body axes (`side` = 1), or its conjugate for inertial axes (`side` = −1).

    The conjugate satisfies the equation in body axes with the conjugate rate.
    """
    return q.at[1:].multiply(side)
