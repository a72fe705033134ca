"""Compute λ(t) for a prescribed ω(t); the rotations of all steps are computed at once and multiplied in parallel.

If the times, the initial quaternion, the tolerance and the values of ω are known, NumPy computes everything, and
nothing is compiled except ω itself if it computes with JAX. Under `grad`, `jvp` and `jacfwd` outside `jit`, NumPy still
chooses the steps. The choice depends on values only; derivatives are computed with these steps fixed. In a jitted
function in which ω and the times are concrete, the steps are chosen during tracing. If the times or parameters of ω are
traced, as under `jit` or `vmap`, the steps are chosen at run time within a fixed number of slots, `max_steps`, and each
slot costs as much as a step. In this case `steps`, a fixed number of equal steps in each interval, is cheaper.
"""

from typing import Any

import numpy as np
from jaxtyping import Array, Float, Int
from typing_extensions import TypeAliasType

from qtraj.foundation.arrays import as_array, as_float, constants, is_traced
from qtraj.foundation.namespace import on_host, stop_gradient, xp
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, extent, times_text
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.checks import at_once
from qtraj.motion.propagation import mesh as meshes, plan
from qtraj.motion.propagation.increment import AbstractIncrement, as_inputs, propagated
from qtraj.motion.propagation.mesh import Errors, Mesh
from qtraj.motion.propagation.problem import (
    KnownProblem,
    Problem,
    Rate,
    at_outputs,
    checked,
    known_part,
    mesh_errors,
    solve,
)

Quats = TypeAliasType("Quats", Float[Array, "n 4"])
"""One quaternion for each instant."""


class Propagation(AbstractOutcome):
    """The attitudes at the output times, with an error estimate.

    `quaternion` (n, 4) at `times` (n,) [s]. `estimate` [rad]: the estimated error angle of the last attitude plus the
    estimated error of ln|λ|, including round-off. `steps`: the number of steps. `code`: a `ResultCode`, determined from
    the error without round-off. `result`: a description of the result.
    """

    times: Float[Array, " n"]
    quaternion: Float[Array, "n 4"]
    estimate: Scalar
    steps: Int[Array, ""]
    code: Int[Array, ""]

    def __init__(
        self, times: ArrayInput, quaternion: ArrayInput, estimate: ArrayInput, steps: ArrayInput, code: ArrayInput
    ):
        self.times, self.quaternion, self.estimate = as_float(times), as_float(quaternion), as_float(estimate)
        self.steps, self.code = xp.asarray(steps), xp.asarray(code)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of one propagation, with the error estimate if the estimate is too large."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        if code == ResultCode.successful:
            return "the propagation reached its tolerance."
        if code != ResultCode.tolerance_not_reached:
            return code.text
        estimate, steps = (np.asarray(x)[at] for x in (self.estimate, self.steps))
        return f"{code.text} The estimated error is {estimate:.3g} rad after {steps} steps."

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        texts = np.asarray(self.result)
        variables = {
            "quaternion": Quantity(
                self.quaternion, "1", "attitude, scalar first, body to inertial", (along, "component")
            ),
            "estimate": Quantity(
                self.estimate, "rad", "estimated error angle of the last attitude plus error of ln|λ|"
            ),
            "steps": Quantity(self.steps, "1", "number of steps"),
            "result": Quantity(texts, "", "description of the result"),
            "code": Quantity(self.code, "1", "result code"),
        }
        reached = f"{np.sum(self.successful)} of {self.code.size} reached the tolerance"
        result = reached if self.code.ndim else str(texts)
        quality = f"estimated error {extent(self.estimate, 'rad')} after {extent(self.steps)} steps"
        summary = f"{batch_prefix(self.code.shape)}{times_text(self.times)}: {quality}; {result}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"})


def propagate(
    omega: Rate,
    q0: ArrayInput,
    times: ArrayInput,
    method: "AbstractIncrement | None" = None,
    axes: str = "body",
    tolerance: ArrayInput | None = None,
    *,
    steps: int | None = None,
    max_steps: int | None = None,
    throw: bool = False,
) -> Quats:
    """Return the quaternions (n, 4) at `times` (n,) [s] of the motion 2λ̇ = λ∘ω(t) with λ(times[0]) = q0.

    `omega(t)` [rad/s] has shape (3,), or (4,) with the scalar part ω0 = d/dt ln|λ|² first. The rate is in body axes, or
    in inertial axes for `axes="inertial"` (2λ̇ = ω∘λ). `q0` (4,) must not be zero and need not be normalised; |λ| is
    |q0| exp(½∫ω0 dt) to round-off. `method`: `GaussLegendre(stages=8)` for None, or `Magnus(order)`. The steps are
    chosen for a total error of `tolerance` [rad], by default 1e-12 in float64 and 1e-5 in float32. `times` determine
    only the output, and need not resolve the motion. An event in ω that is much shorter than an eighth of the time span
    can be missed, because ω is evaluated only at nodes. In this case add an output time during the event.

    With `steps`, each interval between two output times has this number of equal steps, and no error is estimated.

    If the tolerance is not satisfied with `max_steps` steps (2¹⁸; for a traced rate see `plan.traced_slots`), or the
    rate is not finite, all quaternions are NaN. `propagate_with_estimate` returns the reason and the most accurate
    quaternions that were computed.

    For batches, `qtraj.in_blocks` takes fewer steps than `jax.vmap`, and does not compile again for other sizes.

    **Raises:** ValueError for times that are not finite and strictly increasing, a q0 that is zero or not finite, a
    rate of another shape, a tolerance that is not positive, or unknown `axes`. RuntimeError if `throw` is true and the
    quaternions would be NaN.
    """
    problem = checked(omega, q0, times, method, axes, tolerance)
    if steps is not None and problem.intervals > 0:
        return _with_equal_steps(problem, steps)
    solution = _solve(problem, None, max_steps)
    if throw:
        return solution.check().quaternion
    return xp.where(solution.successful, solution.quaternion, np.nan)


def propagate_with_estimate(
    omega: Rate,
    q0: ArrayInput,
    times: ArrayInput,
    method: "AbstractIncrement | None" = None,
    axes: str = "body",
    tolerance: ArrayInput | None = None,
    *,
    steps: int | None = None,
    max_steps: int | None = None,
    throw: bool = False,
) -> "Propagation":
    """Compute the quaternions of `propagate` with an error estimate, even for a fixed number of `steps`.

    The fields `code` and `result` report failures; the quaternions are then not replaced by NaN.

    **Raises:** ValueError in the same cases as `propagate`; RuntimeError if `throw` is true and the tolerance is not
    satisfied or the rate is not finite.
    """
    solution = _solve(checked(omega, q0, times, method, axes, tolerance), steps, max_steps)
    return solution.check() if throw else solution


@np.errstate(all="ignore")  # as in JAX, invalid operations result in NaN and infinity
def _with_equal_steps(problem: Problem, steps: int) -> Quats:
    """Return the quaternions for `steps` equal steps in each interval."""
    plan.require_steps(steps)
    mesh = meshes.uniform(problem.intervals, steps)
    known = known_part(problem)
    rates = None if known is None or _compiled(problem, known) else plan.rates_at_nodes(known, mesh)
    if known is None or rates is None or known.rate.differentiated:
        return solve(problem, meshes.on_device(mesh, problem.times.dtype))
    return as_inputs(_multiplied(problem, mesh, rates), (problem.q0, problem.times))


@np.errstate(all="ignore")
def _solve(problem: Problem, steps: int | None, max_steps: int | None) -> Propagation:
    if steps is not None:
        plan.require_steps(steps)
    plan.require_max_steps(max_steps, problem.intervals)
    inputs = problem.q0, problem.times
    if problem.intervals == 0:
        zero = np.zeros((), np.int32)
        return Propagation(problem.times, problem.q0[None], xp.zeros_like(problem.tolerance), zero, zero)
    with at_once():
        known = known_part(problem)
        planned = None if known is None else plan.known(known, steps, max_steps)
    if known is None or planned is None:
        return _traced(problem, steps, max_steps)
    mesh, rates, errors = planned
    code = _result_code(errors, on_host(constants(problem.tolerance)))
    if _compiled(problem, known):
        # The number of slots is a power of two, so that few sizes are compiled.
        slots = 1 << max(int(mesh.count) - 1, 7).bit_length()
        quaternions = solve(problem, meshes.on_device(meshes.padded(mesh, slots), problem.times.dtype))
        estimate, code = as_inputs((errors.bound, code), inputs)
    else:
        quaternions, estimate, code = as_inputs((_multiplied(problem, mesh, rates), errors.bound, code), inputs)
    return Propagation(problem.times, quaternions, estimate, mesh.count, code)


def _compiled(problem: Problem, known: KnownProblem) -> bool:
    """Return whether JAX computes the quaternions from ω.

    If only q0 is traced, the rates of a NumPy function are constants.
    """
    only_q0 = not known.rate.uses_jax and not is_traced((problem.times, problem.tolerance))
    return known.rate.differentiated or (is_traced(problem) and not only_q0)


def _multiplied(problem: Problem, mesh: Mesh, rates: Any) -> Any:
    """Return the quaternions at the output times from the rates at the nodes, in NumPy unless q0 is traced."""
    q0, (_, h) = problem.q0, meshes.spans(mesh, on_host(problem.times))
    if is_traced(q0):
        rates, h = (as_array(x, q0.dtype) for x in (rates, h))
    else:
        q0 = on_host(q0)
    return at_outputs(q0, propagated(problem.method, problem.axes, q0, rates, h), mesh, problem.intervals)


def _traced(problem: Problem, steps: int | None, max_steps: int | None) -> Propagation:
    if steps is None:
        mesh, errors = plan.traced(problem, max_steps)
    else:
        mesh = meshes.on_device(meshes.uniform(problem.intervals, steps), problem.times.dtype)
        errors = mesh_errors(problem, mesh)
    code = _result_code(errors, stop_gradient(problem.tolerance))
    return Propagation(problem.times, solve(problem, mesh), errors.bound, mesh.count, code)


def _result_code(errors: Errors, tolerance: Scalar) -> Int[Array, ""]:
    failure = xp.where(xp.isfinite(errors.truncation), ResultCode.tolerance_not_reached, ResultCode.not_finite)
    return xp.where(errors.truncation <= tolerance, ResultCode.successful, failure).astype(np.int32)
