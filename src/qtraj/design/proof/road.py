"""Limits on forces, friction and power as inequalities between polynomials in s, √S and √H.

S is the squared speed, and H the squared horizontal speed. The square roots appear with drag, with a bank angle and,
on slopes, with rolling resistance; otherwise the inequalities are polynomial in s. The proof includes the rounding
errors of the vehicle parameters.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.algebra.cells import Cells, PerPath
from qtraj.algebra.chebyshev_model import ChebyshevModel
from qtraj.algebra.rooted import RootSum
from qtraj.algebra.sparse import is_one
from qtraj.path.contact import Contact
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_quantities import ROAD_QUANTITIES
from qtraj.path.vehicle import RoadParameters

ROUNDINGS = 32
"""Bound on the relative rounding error of a parameter of the vehicle, in units of machine epsilon."""


class Bound(NamedTuple):
    """A limit and its square in the units of `PathDerivatives`, each with a bound on its rounding error."""

    first: tuple[Array, Array]
    square: tuple[Array, Array]


class Parameter(eqx.Module):
    """A parameter of the vehicle for each path, with a bound on its error; it can multiply a `RootSum`."""

    value: Array
    error: Array

    def __mul__(self, number: RootSum) -> RootSum:
        return number.scaled(self.value, self.error)


class RoadInvariants:
    """The invariants in the formulas of `contact`, as `RootSum`s, which may contain the roots v = √S and h = √H.

    S is the squared speed, and H the squared horizontal speed.
    """

    def __init__(self, i: Invariants):
        self.squares = squares = i.S, i.H
        for name in ("S", "H", "B", "P", "V", "W"):
            setattr(self, name, RootSum((getattr(i, name), 0, 0, 0), squares))
        self.v, self.h = RootSum((0, 1, 0, 0), squares), RootSum((0, 0, 1, 0), squares)
        self.pace = i.pace if is_one(i.pace) else RootSum((i.pace, 0, 0, 0), squares)
        values = jnp.stack(i.vehicle)[:, None]
        errors = ROUNDINGS * float(jnp.finfo(values.dtype).eps) * jnp.abs(values)
        self.vehicle = RoadParameters(*(Parameter(*x) for x in zip(values, errors, strict=True)))
        self.contact = Contact(self)


def road_slack(place: Array, i: Invariants, bound: Bound, half: Cells) -> ChebyshevModel:
    """Return bound · denominator − numerator in cells of s = 2t/duration − 1.

    The limit is satisfied where this value is not negative. The bound is the limit of a signed quantity, or the square
    of the limit of any other quantity. `place` is the index in `ROAD_QUANTITIES`; the index after the last quantity
    selects the load on the road, times positive factors. The square roots are bounded only once, for all quantities
    together.
    """
    road = RoadInvariants(i)
    road.contact.compute()

    def of(entry: PathQuantity) -> Any:
        denominator: Any = entry.denominator(road)  # type: ignore[misc]
        scaled_denominator = denominator.scaled(*(bound.first if entry.signed else bound.square))
        return (scaled_denominator - entry.numerator(road)).models()

    branches = [*(lambda entry=entry: of(entry) for entry in ROAD_QUANTITIES), lambda: road.contact.onto.models()]
    return RootSum(jax.lax.switch(place, branches), road.squares).model(half)


def in_units(road: RoadParameters, length: PerPath, time: PerPath) -> RoadParameters:
    """Return the parameters of vehicles in the units `length` [m], `time` [s] and kilogram."""
    return road._replace(gravity=road.gravity * time * time / length, drag=road.drag * length)


def relative_load(i: Invariants) -> Any:
    """Return (max(load, 0)/bound)² in [0, 1], where the bound on the load depends on |r''| and gravity."""
    p, load = i.vehicle, jnp.maximum(i.contact.onto, 0.0)
    largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.H)
    positive = largest > 0
    return jnp.where(positive, load * load / jnp.where(positive, largest, 1.0), 0.0)
