"""λ(t) from a known ω(t), in steps that are computed all at once and multiplied in parallel.

Outside `jit` the steps are chosen for the tolerance, also under `grad`, `jvp` and `jacfwd`: the choice depends only on
values, and derivatives are those of the propagation with the chosen steps. A jitted program that knows ω and the times
chooses them while it is traced. Where ω or the times are traced themselves (parameters of ω under `jit` or `vmap`),
the choice is made at run time within a fixed number of slots, `max_steps`, each of which costs as much as a step;
`steps` is cheaper there: so many equal steps in each interval.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import concrete
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, in_lanes, over
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.propagation import plan
from qtraj.motion.propagation.increment import AbstractIncrement
from qtraj.motion.propagation.mesh import Errors
from qtraj.motion.propagation.problem import Problem, Rate, checked, solve, step_errors


class PropagationResult(eqx.Enumeration):
    """How a propagation ended; `PropagationResult[item]` is the text."""

    successful = "the propagation reached its tolerance"
    tolerance_not_reached = (
        "propagation did not reach the tolerance: raise `max_steps` (or `steps`) or the tolerance, or use a method of "
        "higher order"
    )
    not_finite = "propagation met a rate that is NaN or infinite"


_ENDINGS = (
    PropagationResult.successful,
    PropagationResult.tolerance_not_reached,
    PropagationResult.not_finite,
)


class Propagation(AbstractResult):
    """Attitudes at the output times, and how good they are.

    `quaternion` (n, 4) at `times` (n,) [s]; `estimate` [rad] of the error of the last attitude and of ln|λ|², with
    round-off; `steps`, how many were taken; `result`, a `PropagationResult`, by the error without round-off.
    """

    times: Float[Array, " n"]
    quaternion: Float[Array, "n 4"]
    estimate: Scalar
    steps: Int[Array, ""]
    result: PropagationResult

    def record(self) -> Record:
        """The attitudes over `time`, or over `sample` in lanes that have times of their own, and how good they are."""
        along = "time" if self.times.ndim == 1 else "sample"
        code = np.asarray(jax.tree.leaves(self.result)[0])
        texts = _texts()[code]
        variables = {
            "quaternion": Quantity(
                self.quaternion, "1", "attitude, scalar first, body to inertial", (along, "component")
            ),
            "estimate": Quantity(self.estimate, "rad", "estimated error of the last attitude and of ln|λ|²"),
            "steps": Quantity(self.steps, "1", "steps taken"),
            "result": Quantity(texts, "", "how it ended"),
        }
        reached = texts == PropagationResult[PropagationResult.successful]
        ended = f"{np.sum(reached)} of {code.size} reached the tolerance" if code.ndim else str(texts)
        quality = f"estimated error {extent(self.estimate, 'rad')} in {extent(self.steps)} steps"
        summary = f"{in_lanes(code.shape)}{over(self.times)}: {quality}; {ended}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"})


def propagate(
    omega: Rate,
    q0: ArrayInput,
    times: ArrayInput,
    method: AbstractIncrement | None = None,
    axes: str = "body",
    tolerance: ArrayInput | None = None,
    *,
    steps: int | None = None,
    max_steps: int | None = None,
) -> Float[Array, "n 4"]:
    """The quaternions (n, 4) at `times` (n,) [s] of the motion 2λ̇ = λ∘ω(t) with λ(times[0]) = q0.

    `omega(t)` [rad/s] is (3,), or (4,) with the scalar part ω0 = d/dt ln|λ|² first, in body axes, or in inertial ones
    for `axes="inertial"` (2λ̇ = ω∘λ). `q0` (4,) may have any length but zero; it is kept, times exp ½∫ω0, to round-off.
    `method`: `GaussLegendre(stages=8)` unless given, or `Magnus(order)`. The steps are chosen for a total error of
    `tolerance` [rad], 1e-12 in float64 and 1e-5 in float32 unless given; `times` only say where output is wanted.
    An event in ω that is much shorter than an eighth of the span can fall between the nodes: put a time into it.

    `steps` fixes the number of steps in each interval instead, and nothing is estimated.

    **Raises:** ValueError for times that are not finite and strictly increasing, a q0 that is zero or not finite, a
    rate of another shape, other axes. RuntimeError where the tolerance is not reached in `max_steps` steps (2¹⁸; for a
    traced rate see `plan.traced_slots`) or the rate is not finite. `propagate_with_estimate` reports these instead.
    """
    problem = checked(omega, q0, times, method, axes, tolerance)
    if steps is not None and problem.intervals > 0:
        return solve(problem, plan.fixed(problem, steps))
    found = _solved(problem, None, max_steps)
    failed = found.result != PropagationResult.successful
    if concrete(failed) is None:
        return found.result.error_if(found.quaternion, failed)
    if failed:
        raise RuntimeError(
            f"{PropagationResult[found.result]} (the error estimate is {float(found.estimate):.3g} rad in "
            f"{int(found.steps)} steps, the tolerance {float(stop_gradient(problem.tolerance)):.3g} rad)"
        )
    return found.quaternion


def propagate_with_estimate(
    omega: Rate,
    q0: ArrayInput,
    times: ArrayInput,
    method: AbstractIncrement | None = None,
    axes: str = "body",
    tolerance: ArrayInput | None = None,
    *,
    steps: int | None = None,
    max_steps: int | None = None,
) -> Propagation:
    """As `propagate`, with an error estimate, also for given `steps`; a failure is in the `result`, never raised."""
    return _solved(checked(omega, q0, times, method, axes, tolerance), steps, max_steps)


def _solved(problem: Problem, steps: int | None, max_steps: int | None) -> Propagation:
    if problem.intervals == 0:
        nothing, none = jnp.zeros_like(problem.tolerance), jnp.zeros((), jnp.int32)
        return Propagation(problem.times, problem.q0[None], nothing, none, PropagationResult.successful)
    if steps is None:
        mesh, errors = plan.adaptive(problem, max_steps)
    else:
        mesh = plan.fixed(problem, steps)
        errors = step_errors(problem, mesh)
    return Propagation(
        times=problem.times,
        quaternion=solve(problem, mesh),
        estimate=errors.bound,
        steps=mesh.count,
        result=_judged(errors, stop_gradient(problem.tolerance)),
    )


@functools.cache
def _texts() -> np.ndarray:
    """The texts of `PropagationResult` by their codes."""
    codes = [int(jax.tree.leaves(item)[0]) for item in _ENDINGS]
    return np.array([PropagationResult[item] for item in _ENDINGS])[np.argsort(codes)]


@eqx.filter_jit
def _judged(errors: Errors, tolerance: Scalar) -> PropagationResult:
    failure = PropagationResult.where(
        jnp.isfinite(errors.truncation), PropagationResult.tolerance_not_reached, PropagationResult.not_finite
    )
    return PropagationResult.where(errors.truncation <= tolerance, PropagationResult.successful, failure)
