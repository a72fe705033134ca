"""Evaluate a request by the fused kernel or by XLA, with the derivatives of the plain formulas."""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.batch.blocks import reduced
from qtraj.batch.fused_kernel import peaks, supports
from qtraj.batch.instant_formulas import Formulas, OfPath, instant_formulas
from qtraj.batch.kernel_choice import INTERPRET, uses_kernel
from qtraj.batch.reduction import attained, block_peak, joiner
from qtraj.batch.task import Task


def fused_formulas(task: Task, platform: str, work: Any, paths: Any, times: Array) -> Formulas | None:
    """Return the formulas for the kernel, or None if the request is evaluated by XLA.

    XLA evaluates whatever the user did not choose the kernel for, and formulas that are not elementwise.
    """
    if not uses_kernel(task.kernel, platform):
        return None
    found = instant_formulas(work, paths, times)
    return found if supports(found, paths, times) else None


def is_interpreted(task: Task) -> bool:
    """Return whether the kernel is interpreted instead of compiled."""
    return task.kernel == INTERPRET


def fused_or(plain: Callable[..., Any], kernel: Callable[..., Any], worker: Any, task: Task, platform: str) -> Any:
    """Return a function of paths, frame, times and more that calls the kernel where it can, otherwise `plain`.

    `kernel` is a function of `fused_kernel`. `worker` returns the arrays of the paths and the function to evaluate.
    """

    def fused(paths: Any, frame: Any, times: Array, *rest: Array) -> Any:
        arrays, work = worker(paths, frame, task.names)
        formulas = fused_formulas(task, platform, work, arrays, times)
        if formulas is None:
            return plain(paths, frame, times, *rest)
        return kernel(formulas, arrays, times, *rest, interpret=is_interpreted(task))

    return partial(_with_plain_derivatives, fused, plain) if uses_kernel(task.kernel, platform) else plain


def accelerator_peaks(
    task: Task, platform: str, work: Any, paths: Any, times: Array, samples: int
) -> dict[str, tuple[tuple[Array, Array], ...]]:
    """Return (peak, time), each (paths,), for each component by name, by the kernel or in blocks of `samples` instants.

    Samples of a component that does not depend on the instant would be a constant array. XLA would compute its maximum
    while it compiles, by a slow evaluation of every element, so such components are not reduced.
    """
    formulas, reduction = instant_formulas(work, paths, times), str(task.reduce)
    constant = constant_peaks(formulas, paths, times)
    if uses_kernel(task.kernel, platform) and supports(formulas, paths, times):
        return formulas.merged(peaks(formulas, paths, times, reduction, is_interpreted(task)), constant)
    peak, join = block_peak(reduction), joiner(reduction)

    def block(path: Any, cut: Any) -> Any:
        return [peak(x.astype(times.dtype), *cut) for x in formulas.varying_of(work(path, cut))]

    shape = (jax.tree.leaves(paths)[0].shape[0], times.shape[1])
    found = reduced(block, lambda parts: [join(x) for x in parts], paths, (times,), shape, samples)
    return formulas.merged(found, constant)


def constant_peaks(formulas: Formulas, paths: Any, times: Array) -> list[tuple[Array, Array]]:
    """Return (value, first time), each (paths,), of every component that does not depend on the instant."""
    count, tables = jax.tree.leaves(paths)[0].shape[0], formulas.constants(paths)
    first = jnp.broadcast_to(jnp.min(times, axis=1), (count,))

    def peak(x: Any) -> tuple[Array, Array]:
        value = tables[x.dtype][:, x.number] if isinstance(x, OfPath) else jnp.asarray(x)
        value = jnp.broadcast_to(value.astype(times.dtype), (count,))
        return value, jnp.where(attained(value, value), first, jnp.inf)

    return [peak(x) for x, varies in zip(formulas.results, formulas.varying, strict=True) if not varies]


def _with_plain_derivatives(fused: Callable[..., Any], plain: Callable[..., Any], *arguments: Any) -> Any:
    """Return `fused(*arguments)`; in a differentiation, return `plain(*arguments)` with its derivatives."""
    arrays, rest = eqx.partition(arguments, eqx.is_array)
    call = jax.custom_jvp(lambda arrays: fused(*eqx.combine(arrays, rest)))

    @call.defjvp
    def derivative(primals: Any, tangents: Any) -> Any:
        return jax.jvp(lambda arrays: plain(*eqx.combine(arrays, rest)), primals, tangents)

    return call(arrays)
