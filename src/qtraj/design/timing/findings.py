"""Combine the findings on the cells of a timing into a certificate."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Bool, Float, Int

from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED, Certificate
from qtraj.design.timing.directions import straight
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import namespace
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import quantity


def with_straight(
    path: AbstractHodograph, knots: Float[Any, " cells+1"], codes: Int[Any, "limits cells"], names: tuple[str, ...]
) -> Int[Any, "limits cells"]:
    """Return the codes; for the angular rate on straight parts, UNDEFINED replaces UNDECIDED and SAMPLED.

    On straight parts the natural trihedral is undefined.
    """
    if "angular_rate" not in names:
        return codes
    rows = np.array([name == "angular_rate" for name in names])[:, None]
    xp = namespace(codes, knots)
    without = straight(*(stop_gradient((path, knots)) if xp is jnp else (path, knots)))[None] & rows
    return xp.where(without & ((codes == UNDECIDED) | (codes == SAMPLED)), UNDEFINED, codes)


def undefined(codes: Int[Any, "limits cells"]) -> Bool[Any, "limits cells"]:
    """Return a mask of the cells in which a quantity is undefined; false if its limit is violated in some cell."""
    return (codes == UNDEFINED) & ~(codes == BROKEN).any(axis=1, keepdims=True)


def worst_cell(codes: Int[Any, "limits cells"], usage: Float[Any, "limits cells"]) -> Int[Any, " limits"]:
    """Return the cell of the largest usage (quantity divided by limit) of each limit.

    If the limit is violated, this is a cell with a violation, which the samples of the usage may miss. Otherwise, if
    the quantity is undefined in some cell, return the first such cell.
    """
    xp, violated = namespace(codes, usage), codes == BROKEN
    usage = xp.where(violated.any(axis=1, keepdims=True) & ~violated, -np.inf, usage)
    return xp.argmax(xp.where(undefined(codes), np.inf, usage), axis=1)


def undecided_cell(
    codes: Int[np.ndarray, "limits cells"], usage: Float[np.ndarray, "limits cells"], worst: Int[np.ndarray, " limits"]
) -> Int[np.ndarray, " limits"]:
    """Return the undecided cell of the largest usage of each limit, or the `worst` cell without one.

    Only in such a cell can the limit be violated if it is violated in none of the others. Samples in a proved cell next
    to it may be larger than those in it.
    """
    open_ = (codes == UNDECIDED) & ~(codes == BROKEN).any(axis=1, keepdims=True)
    return np.where(open_.any(axis=1), np.argmax(np.where(open_, usage, -np.inf), axis=1), worst)


def certificate(
    codes: Int[Any, "limits cells"],
    times: Float[Any, " limits"],
    values: Float[Any, " limits"],
    limits: Float[Any, " limits"],
    polynomials: MovingPolynomials | None,
    names: tuple[str, ...],
) -> Certificate:
    """Return the certificate for the status `codes` of all cells, and the times and `values` of the maxima.

    The value of a quantity that is undefined in some cell becomes NaN, unless its limit is violated.
    """
    xp = namespace(codes, times, values, limits)
    rank = xp.asarray([0, 1, 4, 2, 3])[codes]  # proved, sampled, undecided, undefined, broken
    whole = xp.asarray([PROVED, SAMPLED, UNDECIDED, UNDEFINED, BROKEN])[xp.max(rank, axis=1)]
    if polynomials is not None and polynomials.placement is not None:
        x, y = xp.asarray(polynomials.placement.orientation)[1:3]
        vertical = np.array([quantity(name).upright for name in names])
        whole = xp.where(vertical & ((x != 0) | (y != 0)), SAMPLED, whole)
    over = np.array([float(quantity(name).side) for name in names]) * (values - limits) > 0
    whole = xp.where(over & ((whole == SAMPLED) | (whole == UNDECIDED)), BROKEN, whole)
    values = xp.where(xp.any(undefined(codes), axis=1), np.nan, values)
    return Certificate(names, whole, times, values, limits)


def joined(found: Sequence[Certificate], names: tuple[str, ...]) -> Certificate:
    """Return one certificate of all limits in the order of `names`; each name is in exactly one of the certificates."""
    own = [name for certificate in found for name in certificate.names]
    order = np.array([own.index(name) for name in names], int)
    xp: Any = jnp if is_traced(found) else np
    fields = ("codes", "times", "values", "limits")
    arrays = ([xp.asarray(getattr(certificate, field)) for certificate in found] for field in fields)
    return Certificate(names, *(xp.concatenate(x, axis=-1)[..., order] for x in arrays))
