"""Compute the results of `retime` in NumPy outside `jit`, and only those that have derivatives in JAX."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation.arrays import constants, is_traced


def with_derivatives(judged: Callable[..., tuple[Any, ...]]) -> Callable[..., tuple[Any, ...]]:
    """Return `judged`, which combines the timings of all parts, for traced arguments.

    Inside `jit` and `vmap` it is compiled. Outside, the values of differentiated arguments are known: the proofs, the
    largest values and the code, which are constants, are then computed in NumPy.
    """

    def call(path: Any, timed: list[Any], bounds: Any, speeds: tuple[Any, Any], vehicle: Any, *rest: Any) -> Any:
        given = path, timed, bounds, speeds, vehicle
        known = constants(given)
        if is_traced(known):
            return eqx.filter_jit(judged)(*given, *rest)
        numbers = jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, known)
        _, _, certificate, usage, _, *more = judged(*numbers, *rest)
        changes = [x.found.sensitivity for x in timed if x.found is not None]
        timing, duration, ends = _differentiated(
            [x.powers for x in timed], [x.knots for x in timed], changes, speeds[0], rest[-1]
        )
        return RetimedPath(path, timing), duration, certificate, usage, ends, *more

    return call


@eqx.filter_jit
def _differentiated(
    powers: Any, knots: Any, changes: list[Any], pace: Any, rest: tuple[bool, bool]
) -> tuple[Timing, Any, Any]:
    """Return the timing, its duration and the speeds at its ends, from the arrays of all parts."""
    powers = jnp.concatenate([jnp.asarray(x) for x in powers])
    timing = Timing(powers, joined([jnp.asarray(x) for x in knots]), rest)
    duration = jax.lax.stop_gradient(timing.duration) + sum(changes)
    return timing, duration, at_ends(powers, pace, rest)


def joined(knots: list[Any]) -> Any:
    """Return the knots of all parts; a part starts where the part before it ends."""
    xp: Any = jnp if is_traced(knots) else np
    return xp.concatenate([knots[0][:1], *(x[1:] for x in knots)])


def at_ends(powers: Any, pace: Any, rest: tuple[bool, bool]) -> Any:
    """Return the speeds at both ends [m/s]; `pace` are those of the path, and `rest` indicates where u̇² is zero."""
    xp: Any = jnp if is_traced(powers, pace) else np
    squares = xp.where(np.array(rest), 0.0, xp.stack([powers[0, 0], xp.sum(powers[-1])]))
    return xp.where(squares > 0, xp.sqrt(xp.where(squares > 0, squares, 1.0)), 0.0) * pace
