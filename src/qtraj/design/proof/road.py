"""Limits on forces, friction and power as inequalities: polynomials in s and in the roots of S and H.

The roots appear with drag, with a bank and, on slopes, with rolling resistance. Without these the inequalities are
polynomial. The parameters of the vehicle are numbers of known uncertainty, which the proof includes.
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
"""Bound on the rounding of a parameter, which is computed from a few numbers, in units of round-off."""


class Bound(NamedTuple):
    """A limit and its square in the units of `PathDerivatives`, each with a bound on its rounding."""

    first: tuple[Array, Array]
    square: tuple[Array, Array]


class Parameter(eqx.Module):
    """A known number of either sign for each path, which multiplies sums with roots."""

    value: Array
    error: Array

    def __mul__(self, number: RootSum) -> RootSum:
        return number.scaled(self.value, self.error)


class RoadInvariants(Contact):
    """The invariants that the formulas of `contact` use, as sums with roots; v = √S and h = √H."""

    def __init__(self, i: Invariants):
        self.squares = squares = i.S, i.H
        for name in ("S", "H", "B", "P", "V", "W"):
            setattr(self, name, RootSum((getattr(i, name), 0, 0, 0), squares))
        self.v, self.h = RootSum((0, 1, 0, 0), squares), RootSum((0, 0, 1, 0), squares)
        self.pace = i.pace if is_one(i.pace) else RootSum((i.pace, 0, 0, 0), squares)
        values = jnp.stack(i.vehicle)[:, None]
        errors = ROUNDINGS * float(jnp.finfo(values.dtype).eps) * jnp.abs(values)
        self.vehicle = RoadParameters(*(Parameter(*x) for x in zip(values, errors, strict=True)))


def road_slack(place: Array, i: Invariants, bound: Bound, half: Cells) -> ChebyshevModel:
    """bound · denominator − numerator in cells: a limit is satisfied where this is not negative.

    `place` is the index in `ROAD_QUANTITIES`; the last is the load on the road, times positive numbers. The roots are
    enclosed once for all of them.
    """
    road = RoadInvariants(i)
    road.compute()

    def of(entry: PathQuantity) -> Any:
        denominator: Any = entry.denominator(road)  # type: ignore[misc]
        scaled_denominator = denominator.scaled(*(bound.first if entry.signed else bound.square))
        return (scaled_denominator - entry.numerator(road)).models()

    branches = [*(lambda entry=entry: of(entry) for entry in ROAD_QUANTITIES), lambda: road.onto.models()]
    return RootSum(jax.lax.switch(place, branches), road.squares).model(half)


def in_units(road: RoadParameters, length: PerPath, time: PerPath) -> RoadParameters:
    """The parameters of vehicles where lengths and times have these units; the mass stays in kilograms."""
    return road._replace(gravity=road.gravity * time * time / length, drag=road.drag * length)


def relative_load(i: Invariants) -> Any:
    """The square of the positive part of the load over its largest value with these accelerations; in [0, 1]."""
    p, load = i.vehicle, jnp.maximum(i.onto, 0.0)
    largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.H)
    positive = largest > 0
    return jnp.where(positive, load * load / jnp.where(positive, largest, 1.0), 0.0)
