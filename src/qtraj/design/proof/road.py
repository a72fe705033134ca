"""Limits on forces, friction and power as inequalities: polynomials in s and in the roots of S and H.

The roots appear with drag, with a bank and, on slopes, with rolling resistance. Without these the inequalities are
polynomial. The parameters of the vehicle are numbers of known uncertainty, which the proof includes.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from qtraj.algebra.cells import Cells, PerPath
from qtraj.algebra.chebyshev_model import ChebyshevModel
from qtraj.algebra.rooted import RootSum
from qtraj.algebra.sparse import is_one
from qtraj.path import contact
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.vehicle import RoadParameters

ROUNDINGS = 32
"""Bound on the rounding of a parameter, which is computed from a few numbers, in units of round-off."""


class Parameter(eqx.Module):
    """A known number of either sign for each path, which multiplies sums with roots."""

    value: Array

    def __mul__(self, number: RootSum) -> RootSum:
        error = ROUNDINGS * float(jnp.finfo(self.value.dtype).eps) * jnp.abs(self.value)
        return number.scaled(self.value[None], error[None])


class RoadInvariants:
    """The invariants that the formulas of `contact` use, as sums with roots; v = √S and h = √H."""

    def __init__(self, i: Invariants):
        squares = i.S, i.H
        for name in ("S", "H", "B", "P", "V", "W"):
            setattr(self, name, RootSum((getattr(i, name), 0, 0, 0), squares))
        self.v, self.h = RootSum((0, 1, 0, 0), squares), RootSum((0, 0, 1, 0), squares)
        self.pace = i.pace if is_one(i.pace) else RootSum((i.pace, 0, 0, 0), squares)
        self.vehicle = RoadParameters(*(Parameter(x) for x in i.vehicle))


def road_slack(entry: PathQuantity, i: Invariants, bound: tuple[Array, Array], half: Cells) -> ChebyshevModel:
    """bound · denominator − numerator in cells: the limit is satisfied where this is not negative."""
    road: Any = RoadInvariants(i)
    denominator: Any = entry.denominator(road)  # type: ignore[misc]
    return (denominator.scaled(*bound) - entry.numerator(road)).model(half)


def load(i: Invariants, half: Cells) -> ChebyshevModel:
    """The load on the road in cells, times positive numbers."""
    return contact.onto(RoadInvariants(i)).model(half)


def in_units(road: RoadParameters, length: PerPath, time: PerPath) -> RoadParameters:
    """The parameters of vehicles where lengths and times have these units; the mass stays in kilograms."""
    return road._replace(gravity=road.gravity * time * time / length, drag=road.drag * length)


def relative_load(i: Invariants) -> Any:
    """The square of the positive part of the load, relative to its largest value with these accelerations; in [0, 1]."""
    p, load = i.vehicle, jnp.maximum(contact.onto(i), 0.0)
    largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.H)
    positive = largest > 0
    return jnp.where(positive, load * load / jnp.where(positive, largest, 1.0), 0.0)
