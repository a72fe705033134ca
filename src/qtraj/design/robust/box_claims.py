"""The claims that limits are satisfied on all paths of a box, and their decisions."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.box_subdivision import BoxDecision, decide
from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.degrees import Degrees
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.tensor_forms import Form, in_floats, in_integers, nodes
from qtraj.design.proof import units
from qtraj.design.proof.limit_claims import DIVISOR_ORDER, DIVISORS, Bound, Formulas
from qtraj.design.robust.family import Family
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_parameters import RoadParameters

MAX_WORK = 400_000_000
"""Largest work to evaluate formulas in integers, about 20 s: the number of nodes times (coefficients in the time)³.

One node takes 2.5 ms with 31 coefficients, 25 ms with 73, and 130 to 240 ms with 139.
"""

MAX_NUMBERS = 4_000_000
"""Largest number of coefficients of a form in floats."""

BITS = 36
"""Number of bits of an interval of masses, so that the masses at the nodes are exact floats."""


class OutwardInterval(NamedTuple):
    """An interval of masses, or of another number of a vehicle, with ends that are rounded outwards to `BITS` bits."""

    low: float
    high: float
    rounded: bool
    """Whether masses were added, so that a violated limit may be one of these masses only."""

    @classmethod
    def around(cls, low: float, high: float) -> OutwardInterval:
        """Return a slightly larger interval; its lowest mass is zero if `low` is less than 2^-BITS times `high`."""
        unit = np.ldexp(1.0, int(np.frexp(high)[1]) - BITS)
        own = float(np.floor(low / unit) * unit), float(np.ceil(high / unit) * unit)
        return cls(*own, own != (low, high))

    def at(self, fractions: Any) -> Any:
        """Return the masses at fractions of the interval that are nodes; nothing is rounded."""
        return self.low + (self.high - self.low) * fractions


class BoxClaims:
    """Claims about all paths of a family.

    The last parameters are those of `RoadParameters` that deviate, in the order of their `intervals`.
    """

    def __init__(self, family: Family, vehicle: RoadParameters, intervals: dict[str, OutwardInterval], fastest: float):
        self.family, self.vehicle, self.intervals = family, vehicle, intervals
        self.count = len(family.names) + len(intervals)
        self._fastest = fastest  # squared, in the units of the source
        self._floats: dict[Any, Formulas] = {}
        self._exact: dict[Any, Formulas] = {}
        self._divisors: dict[str, BoxDecision] = {}

    def limit(self, entry: PathQuantity, bound: float, factor: float) -> BoxDecision:
        """Decide whether a limit is satisfied at all times on all paths."""
        strict_bound = float(entry.strict_tangent(np.array([bound]))[0])
        order = max(1, entry.order)
        source = self.family.source

        def claim(formulas: Formulas, number: Callable[[float, int, int], Any]) -> AnyClaim:
            own = None if entry.factor is None else number(factor, 0, 0)
            return formulas.within(entry, Bound(number(strict_bound, entry.length, entry.per_time), own))

        def in_source_units(count: int) -> Callable[[float, int, int], Any]:
            scale = lambda x, m, s: x * source.duration[0] ** s / source.length[0] ** m  # noqa: E731
            return lambda x, m, s: BoundedPolynomial.constant(np.full(count, scale(x, m, s)), k=12)

        return self._decided(
            order,
            lambda f: claim(f, lambda x, m, s: self._no_degrees()),
            lambda f, count: claim(f, in_source_units(count)),
            lambda f: claim(f, lambda x, m, s: ExactPolynomial.of(x)),
            strict=False,
        )

    @property
    def rounded(self) -> bool:
        """Whether the claims are also about masses or drags that are not in the box."""
        return any(x.rounded for x in self.intervals.values())

    def divisor(self, name: str) -> BoxDecision:
        """Decide whether a divisor of a quantity is positive at all times on all paths of the box."""
        if name == "level" and (stops := self.divisor("speed")).refuted:
            return stops  # the horizontal speed is compared with the speed, which proves nothing if both are zero
        if name not in self._divisors:
            length = self.family.source.length[0]
            found = self._decided(
                DIVISOR_ORDER[name],
                lambda f: f.divisor(name, self._no_degrees()),
                lambda f, count: f.divisor(name, BoundedPolynomial.constant(np.full(count, self._fastest))),
                lambda f: f.divisor(name, units.times_power(ExactPolynomial.of(self._fastest), length, 2)),
                strict=True,
            )
            # A divisor with a mass may be zero at added masses only.
            known = name in DIVISORS or not self.rounded
            self._divisors[name] = found if known else found._replace(refuted=False)
        return self._divisors[name]

    def _decided(
        self,
        order: int,
        of_degrees: Callable[[Formulas], AnyClaim],
        of_floats: Callable[[Formulas, int], AnyClaim],
        of_integers: Callable[[Formulas], AnyClaim],
        strict: bool,
    ) -> BoxDecision:
        known = Formulas(
            self.family.degrees(order, self.count), lambda x: self._no_degrees(), self._degrees_of_vehicle()
        )
        claim = of_degrees(known)
        each = [x.exponents if isinstance(x, Degrees) else (0,) * self.count for x in claim.polynomials]
        degrees = tuple(max(column) for column in zip(*each, strict=True)) if self.count else ()
        count = int(np.prod([d + 1 for d in degrees]))
        if count > MAX_NUMBERS // 100:
            return BoxDecision(False, False, (0.5,) * (1 + self.count))
        with np.errstate(all="ignore"):
            floats = of_floats(self._in_floats(order, degrees), count)
            forms = [in_floats(_of_all(p, count), degrees) for p in floats.polynomials]

        def exact_forms() -> list[Form] | None:
            if count * max(len(f.numbers) for f in forms) ** 3 > MAX_WORK:
                return None
            points = list(product(*(nodes(d) for d in degrees)))
            claims = [of_integers(self._in_integers(order, point)) for point in points]
            columns = zip(*(x.polynomials for x in claims), strict=True)
            return [in_integers([_exact(p) for p in column], degrees) for column in columns]

        return decide(floats, forms, exact_forms, strict)

    def _in_floats(self, order: int, degrees: tuple[int, ...]) -> Formulas:
        if (order, degrees) not in self._floats:
            columns = np.array(list(product(*(nodes(d) for d in degrees))), float)
            vehicle = self.vehicle._replace(**self._at(columns.T[len(self.family.names) :]))
            scaled = units.scaled_vehicle(vehicle, self.family.source)
            own = scaled.each(lambda x: np.broadcast_to(np.asarray(x, float), (len(columns),)))
            known = units.constants(own, lambda x: BoundedPolynomial.constant(np.asarray(x), k=6))
            constant = lambda x: BoundedPolynomial.constant(np.full(len(columns), units.as_number(x)), k=1)  # noqa: E731
            self._floats[order, degrees] = Formulas(self.family.bounded(order, degrees), constant, known)
        return self._floats[order, degrees]

    def _in_integers(self, order: int, point: tuple[Any, ...]) -> Formulas:
        if (order, point) not in self._exact:
            vehicle = self.vehicle._replace(**self._at([float(x) for x in point[len(self.family.names) :]]))
            known = units.constants(vehicle.each(lambda x: np.asarray(x, float)), ExactPolynomial.of)
            self._exact[order, point] = Formulas(self.family.exact(order, point), ExactPolynomial.of, known)
        return self._exact[order, point]

    def _no_degrees(self) -> Degrees:
        return Degrees((0,) * self.count)

    def _at(self, fractions: Any) -> dict[str, Any]:
        """Return the numbers of the vehicle at fractions of their intervals."""
        return {name: x.at(s) for (name, x), s in zip(self.intervals.items(), fractions, strict=True)}

    def _degrees_of_vehicle(self) -> Any:
        known = units.constants(self.vehicle.each(lambda x: np.asarray(x, float)), lambda x: self._no_degrees())
        first = len(self.family.names)
        own = {name: Degrees([int(k == j) for j in range(self.count)]) for k, name in enumerate(self.intervals, first)}
        return known._replace(**own)


def _of_all(p: Any, count: int) -> BoundedPolynomial:
    return p if isinstance(p, BoundedPolynomial) else BoundedPolynomial.constant(np.full(count, float(p)))


def _exact(p: Any) -> ExactPolynomial:
    return p if isinstance(p, ExactPolynomial) else ExactPolynomial([int(p)])
