"""Combine the findings on the cells of a timing into a certificate."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED, Certificate
from qtraj.design.timing.directions import straight
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES


def with_straight(
    path: AbstractHodograph, knots: Float[Array, " cells+1"], codes: Int[Array, "limits cells"], names: tuple[str, ...]
) -> Int[Array, "limits cells"]:
    """Return the codes; for the angular rate on straight parts, UNDEFINED replaces UNDECIDED and SAMPLED.

    On straight parts the natural trihedral is undefined.
    """
    if "angular_rate" not in names:
        return codes
    rows = np.array([name == "angular_rate" for name in names])[:, None]
    without = straight(*stop_gradient((path, knots)))[None] & rows
    return jnp.where(without & ((codes == UNDECIDED) | (codes == SAMPLED)), UNDEFINED, codes)


def undefined(codes: Int[Array, "limits cells"]) -> Bool[Array, "limits cells"]:
    """Return a mask of the cells in which a quantity is undefined; false if its limit is violated in some cell."""
    return (codes == UNDEFINED) & ~jnp.any(codes == BROKEN, axis=1, keepdims=True)


def worst_cell(codes: Int[Array, "limits cells"], usage: Float[Array, "limits cells"]) -> Int[Array, " limits"]:
    """Return the cell of the largest usage (quantity divided by limit) of each limit.

    If the quantity is undefined in some cell, return the first such cell, unless the limit is violated.
    """
    return jnp.argmax(jnp.where(undefined(codes), jnp.inf, usage), axis=1)


def certificate(
    codes: Int[Array, "limits cells"],
    times: Float[Array, " limits"],
    values: Float[Array, " limits"],
    limits: Float[Array, " limits"],
    polynomials: MovingPolynomials | None,
    names: tuple[str, ...],
) -> Certificate:
    """Return the certificate for the status `codes` of all cells, and the times and `values` of the maxima.

    The value of a quantity that is undefined in some cell becomes NaN, unless its limit is violated.
    """
    rank = jnp.asarray([0, 1, 4, 2, 3])[codes]  # proved, sampled, undecided, undefined, broken
    whole = jnp.asarray([PROVED, SAMPLED, UNDECIDED, UNDEFINED, BROKEN])[jnp.max(rank, axis=1)]
    if polynomials is not None and polynomials.placement is not None:
        x, y = polynomials.placement.orientation[1:3]
        vertical = np.array([QUANTITIES[name].upright for name in names])
        whole = jnp.where(vertical & ((x != 0) | (y != 0)), SAMPLED, whole)
    over = values > limits
    whole = jnp.where(over & ((whole == SAMPLED) | (whole == UNDECIDED)), BROKEN, whole)
    values = jnp.where(jnp.any(undefined(codes), axis=1), jnp.nan, values)
    return Certificate(names, whole, times, values, limits)


@eqx.filter_jit
def joined(found: Sequence[Certificate], names: tuple[str, ...]) -> Certificate:
    """Return one certificate of all limits in the order of `names`; each name is in exactly one of the certificates."""
    own = [name for certificate in found for name in certificate.names]
    order = np.array([own.index(name) for name in names], int)
    fields = ("codes", "times", "values", "limits")
    arrays = ([jnp.asarray(getattr(certificate, field)) for certificate in found] for field in fields)
    return Certificate(names, *(jnp.concatenate(x, axis=-1)[..., order] for x in arrays))
