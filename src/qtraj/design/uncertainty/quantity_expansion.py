"""Path quantities as functions of the derivatives of the path, with exact gradients and Hessians.

The formulas are those of the registry, computed with jets. A function of the user that is not a formula is
differentiated by JAX.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.algebra.jets import Jet, coordinates, sqrt
from qtraj.path.channel import MAGNITUDES
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity


class Expansion(NamedTuple):
    """A quantity at n instants, with its gradient and Hessian with respect to k numbers."""

    value: Float[np.ndarray, " n"]
    gradient: Float[np.ndarray, "k n"]
    hessian: Float[np.ndarray, "k k n"]


def _course(i: Any) -> Any:
    """Return the heading as a jet: along the present heading, the transverse velocity is zero."""
    x, y = i.r[1][0], i.r[1][1]
    angle = np.arctan2(y.value, x.value)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = (cos * y - sin * x) / (cos * x + sin * y)
    return turned.apply(angle, 1.0, 0.0)  # the derivatives of the arctangent at zero


HEADING = PathQuantity(
    "heading",
    "ψ",
    "rad",
    1,
    "heading: angle of the horizontal velocity from the x axis to the left, between -pi and pi",
    numerator=_course,
    divisor="level",
    signed=_course,
)
"""The direction of travel; it is no entry of the registry, because limits on it would need its turns."""


def expand(entry: PathQuantity, r: Float[np.ndarray, "k n"], lowest: int, road: Any) -> Expansion:
    """Return a quantity as a function of the derivatives of the path from the order `lowest`, in world axes.

    The k numbers are the components of the derivatives, in order. `road` contains the parameters of a vehicle.
    """
    if entry.own is not None and entry.own.formula is None:
        return _expand_function(entry, r, lowest, road)
    with np.errstate(all="ignore"):  # poles are NaN or infinite
        jet = _jet(entry, Invariants(_vectors(coordinates(r), lowest), None, road, sqrt))
        jet = jet * entry.scale(road)
    return Expansion(
        np.broadcast_to(jet.value, r.shape[1:]),
        np.broadcast_to(jet.gradient, r.shape),
        np.broadcast_to(jet.hessian, (len(r), *r.shape)),
    )


def _jet(entry: PathQuantity, i: Invariants) -> Jet:
    component = entry.component
    if entry.signed is None and component is not None:
        # A magnitude has the standard deviation of its signed value, also where it is zero.
        return _magnitude(_angle(entry, _quotient(component, i)))
    found = _quotient(entry, i)
    if entry.variable in MAGNITUDES:
        return _magnitude(found)
    if entry.signed is None:
        found = sqrt(found)
        # The length of a vector has no derivative at zero.
        found = found.apply(found.value, np.where(found.value == 0, np.nan, 1.0), 0.0)
    return _angle(entry, found)


def _magnitude(found: Jet) -> Jet:
    return found * np.where(found.value < 0, -1.0, 1.0)


def _quotient(entry: Any, i: Invariants) -> Jet:
    found = entry.numerator(i)
    return found if entry.denominator is None else found / entry.denominator(i)


def _angle(entry: PathQuantity, found: Jet) -> Jet:
    """Return the angle of its tangent, if the entry is an angle."""
    if not entry.tangent_of:
        return found
    x, part = found.value, entry.tangent_of
    slope = part / (1 + x * x)
    return found.apply(part * np.arctan(x), slope, -2 * x * slope / (1 + x * x))


def _vectors(numbers: Any, lowest: int) -> list[Any]:
    return [*[None] * lowest, *(tuple(numbers[k : k + 3]) for k in range(0, len(numbers), 3))]


def _expand_function(entry: PathQuantity, r: Float[np.ndarray, "k n"], lowest: int, road: Any) -> Expansion:
    with jax.enable_x64(True):
        found = _derivatives(entry, lowest, jnp.asarray(r.T), road)
    return Expansion(*(np.moveaxis(np.asarray(x, float), 0, -1) for x in found))


@eqx.filter_jit
def _derivatives(entry: PathQuantity, lowest: int, rows: Any, road: Any) -> Any:
    """Return values, gradients and Hessians of a function of the user; one compilation for each number of `rows`."""

    def value(numbers: Any) -> Any:
        return jnp.asarray(entry.value(Invariants(_vectors(numbers, lowest), None, road)))

    return jax.vmap(lambda x: (value(x), jax.grad(value)(x), jax.hessian(value)(x)))(rows)
