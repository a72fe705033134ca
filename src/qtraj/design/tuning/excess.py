"""How far a limit is exceeded at one instant, and how that changes with the variables and the time.

g = ½((value/limit)² − 1) depends on few numbers: the Taylor coefficients of ρ, φ and h there, and the duration. Their
own derivatives are Taylor coefficients again: in time the next ones, in the variables those of what a variable does to
the polynomials. So g is differentiated in these numbers alone, forward over reverse, and the chain rule does the rest.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.design.magnitudes import PER_TIME, order_of, squared_of_spiral
from qtraj.design.tuning.problem import Course, Problem, Variables
from qtraj.foundation.types import Scalar
from qtraj.path.components import times, total


class Moves(NamedTuple):
    """A course and its derivatives in the variables z."""

    course: Course
    directions: Course  # what each variable does to it, in the last axes
    slopes: Float[Array, "q n"]  # the same, all its numbers in a row
    bends: Float[Array, "q n n"]


class Derivatives(NamedTuple):
    """Of g at a fraction u of the duration: value, slope and curvature in z, the slope's change with u, and g_uu."""

    value: Scalar
    slope: Variables
    curvature: Float[Array, "n n"]
    mixed: Variables
    bend: Scalar


class _Numbers(NamedTuple):
    """What g depends on, or a derivative of that: the integer 0 for what vanishes identically."""

    radius: list[Any]
    angle: list[Any]
    height: list[Any]
    duration: Any


class Excess(NamedTuple):
    """g of one limit."""

    problem: Problem
    name: str
    limit: Scalar

    def __call__(self, course: Course, u: Scalar) -> Scalar:
        """g at the fraction `u` of the duration."""
        return self._of(*self._numbers(course, u))

    def slope(self, moves: Moves, u: Scalar) -> tuple[Scalar, Variables]:
        """g and its slope in the variables."""
        value, slope = jax.value_and_grad(self)(moves.course, u)
        return value, in_a_row(slope) @ moves.slopes

    def derivatives(self, moves: Moves, u: Scalar) -> Derivatives:
        """g and its derivatives in the variables and in `u`."""
        here, first, second = self._numbers(moves.course, u, 2)
        directions, turned = self._numbers(moves.directions, u, 1)
        (value, slope), onward = jax.linearize(jax.value_and_grad(self._of), here)
        _, bent = jax.vmap(onward)(jax.tree.map(_beside, first, directions))
        numbers, pull = jax.vjp(lambda course: self._numbers(course, u)[0], moves.course)
        structure = jax.tree.structure(numbers)
        # XLA repeats what is cheap in all that uses it, but no division, and cannot know that this is one by 1.
        one = jnp.where(moves.course.duration > 0, 1.0, 2.0)
        rows = jnp.concatenate([jnp.stack(jax.tree.leaves(slope))[None], jnp.stack(jax.tree.leaves(bent), -1)]) / one
        slope, in_time = (jax.tree.unflatten(structure, list(row)) for row in rows[:2])
        of_course = jax.vmap(lambda row: in_a_row(*pull(jax.tree.unflatten(structure, list(row)))))(rows)
        in_variables = of_course @ moves.slopes
        return Derivatives(
            value=value,
            slope=in_variables[0],
            curvature=in_variables[2:] + jnp.tensordot(of_course[0], moves.bends, 1),
            mixed=in_variables[1] + _along(slope, turned),
            bend=_along(in_time, first) + _along(slope, second),
        )

    def _of(self, numbers: _Numbers) -> Scalar:
        count = order_of(self.name) + 1
        radius, angle, height = (
            [*[0] * first, *series, *[0] * (count - first - len(series))]
            for first, series in zip(self._firsts, numbers[:3], strict=True)
        )
        # In unit time, which is simpler to differentiate: the limit is scaled instead.
        one = jnp.ones_like(numbers.duration)
        value = squared_of_spiral(self.name, (radius, angle, height), one, self.problem.placement)
        return 0.5 * (value / (self.limit * numbers.duration ** PER_TIME[self.name]) ** 2 - 1.0)

    @property
    def _firsts(self) -> tuple[int, int, int]:
        """The lowest orders that matter: azimuth and height only do where the axis may lean against the vertical."""
        return (0, 0 if self.name == "slope" and self.problem.placement is not None else 1, 1)

    def _numbers(self, course: Course, u: Scalar, changes: int = 0) -> list[_Numbers]:
        """What g depends on at the fraction `u` of the duration, and so many derivatives of it in `u`."""
        order = order_of(self.name)
        polynomials = (course.radius, course.angle, course.height)
        series = [polynomial.terms(c, u, order + changes) for c in polynomials]
        kept = [range(first, min(order + 1, c.shape[0])) for first, c in zip(self._firsts, polynomials, strict=True)]

        def changed(n: int) -> _Numbers:
            duration = 0 if n else course.duration
            radius, angle, height = (_changed(c, ks, n) for c, ks in zip(series, kept, strict=True))
            return _Numbers(radius, angle, height, duration)

        return [changed(n) for n in range(changes + 1)]


def _changed(series: list[Any], orders: Iterable[int], n: int) -> list[Any]:
    """The n-th derivatives of the Taylor coefficients of these orders."""
    return [times(math.perm(k + n, n), series[k + n]) for k in orders]


def in_a_row(course: Course, *rest: int) -> Float[Array, "q *rest"]:
    """All numbers of a course, or what belongs to each of them."""
    return jnp.concatenate([x.reshape(-1, *rest) for x in course])


def _along(slope: _Numbers, change: _Numbers) -> Any:
    """How what has this slope changes."""
    pairs = zip(jax.tree.leaves(slope), jax.tree.leaves(change), strict=True)
    return total([times(a, b) for a, b in pairs])


def _beside(one: Any, others: Float[Array, " n"]) -> Float[Array, " n+1"]:
    return jnp.concatenate([jnp.broadcast_to(one, (1,)).astype(others.dtype), others])
