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
from qtraj.design.robust.box_vehicle import DRAG, INVERSE_MASS, BoxVehicle
from qtraj.design.robust.family import Family
from qtraj.path.path_quantity import PathQuantity

MAX_WORK = 400_000_000
"""Largest work to evaluate formulas in integers, about 20 s: the number of nodes times (coefficients in the time)³.

One node takes 2.5 ms with 31 coefficients, 25 ms with 73, and 130 to 240 ms with 139.
"""

MAX_NUMBERS = 4_000_000
"""Largest number of coefficients of a form in floats."""


class Known(NamedTuple):
    """The formulas of all paths of a box, and the factor of limits on forces, None for 1."""

    formulas: Formulas
    of_forces: Any


class BoxClaims:
    """Claims about all paths of a family.

    The last parameters are those of the vehicle, in the order of its `intervals`.
    """

    def __init__(self, family: Family, vehicle: BoxVehicle, fastest: float):
        self.family, self.vehicle = family, vehicle
        self.count = len(family.names) + len(vehicle.intervals)
        self._fastest = fastest  # squared, in the units of the source
        self._floats: dict[Any, Known] = {}
        self._exact: dict[Any, Known] = {}
        self._divisors: dict[str, BoxDecision] = {}

    def limit(self, entry: PathQuantity, bound: float, factor: float) -> BoxDecision:
        """Decide whether a limit is satisfied at all times on all paths."""
        strict_bound = float(entry.strict_tangent(np.array([bound]))[0])
        order = max(1, entry.order)
        source, is_force = self.family.source, self._is_force(entry)

        def claim(known: Known, number: Callable[[float, int, int], Any]) -> AnyClaim:
            own = None if entry.factor is None else number(factor, 0, 0)
            limit = number(strict_bound, entry.length, entry.per_time)
            return known.formulas.within(entry, Bound(limit * known.of_forces if is_force else limit, own))

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

    def _is_force(self, entry: PathQuantity) -> bool:
        """Return whether a quantity is proportional to a mass that deviates."""
        if INVERSE_MASS not in self.vehicle.intervals:
            return False
        none, place = self._no_degrees(), len(self.family.names)
        mass = Degrees([int(k == place) for k in range(self.count)])
        vehicle = units.constants(self.vehicle.road.each(lambda x: np.asarray(x, float)), lambda x: none)
        motion = self.family.degrees(max(1, entry.order), self.count)
        formulas = Formulas(motion, lambda x: none, vehicle._replace(mass=mass))
        claim = formulas.within(entry, Bound(none, None if entry.factor is None else none))
        return any(isinstance(p, Degrees) and p.exponents[place] > 0 for p in claim.polynomials)

    def divisor(self, name: str) -> BoxDecision:
        """Decide whether a divisor of a quantity is positive at all times on all paths of the box."""
        if name == "level" and (stops := self.divisor("speed")).refuted:
            return stops  # the horizontal speed is compared with the speed, which proves nothing if both are zero
        if name not in self._divisors:
            length = self.family.source.length[0]
            found = self._decided(
                DIVISOR_ORDER[name],
                lambda x: x.formulas.divisor(name, self._no_degrees()),
                lambda x, count: x.formulas.divisor(name, BoundedPolynomial.constant(np.full(count, self._fastest))),
                lambda x: x.formulas.divisor(name, units.times_power(ExactPolynomial.of(self._fastest), length, 2)),
                strict=True,
            )
            # A divisor with a number of the vehicle may be zero at added numbers only.
            known = name in DIVISORS or not self.vehicle.rounded
            self._divisors[name] = found if known else found._replace(refuted=False)
        return self._divisors[name]

    def _decided(
        self,
        order: int,
        of_degrees: Callable[[Known], AnyClaim],
        of_floats: Callable[[Known, int], AnyClaim],
        of_integers: Callable[[Known], AnyClaim],
        strict: bool,
    ) -> BoxDecision:
        vehicle, of_forces = self.vehicle.degrees(self.count)
        motion = self.family.degrees(order, self.count)
        claim = of_degrees(Known(Formulas(motion, lambda x: self._no_degrees(), vehicle), of_forces))
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

    def _in_floats(self, order: int, degrees: tuple[int, ...]) -> Known:
        if (order, degrees) not in self._floats:
            source = self.family.source
            columns = np.array(list(product(*(nodes(d) for d in degrees))), float)

            def constant(x: Any) -> BoundedPolynomial:
                own = np.broadcast_to(np.asarray(units.as_number(x) if np.ndim(x) == 0 else x, float), (len(columns),))
                return BoundedPolynomial.constant(own, k=6)

            own = self.vehicle.at([*columns.T[len(self.family.names) :]])
            scaled = units.scaled_vehicle(self.vehicle.road, source)
            if DRAG in own:
                own[DRAG] = own[DRAG] * source.length[0]
            vehicle, of_forces = self.vehicle.with_numbers(
                {name: constant(x) for name, x in own.items()}, constant, scaled, source.length[0]
            )
            self._floats[order, degrees] = Known(
                Formulas(self.family.bounded(order, degrees), constant, vehicle), of_forces
            )
        return self._floats[order, degrees]

    def _in_integers(self, order: int, point: tuple[Any, ...]) -> Known:
        if (order, point) not in self._exact:
            vehicle, of_forces = self.vehicle.exactly([float(x) for x in point[len(self.family.names) :]])
            formulas = Formulas(self.family.exact(order, point), ExactPolynomial.of, vehicle)
            self._exact[order, point] = Known(formulas, of_forces)
        return self._exact[order, point]

    def _no_degrees(self) -> Degrees:
        return Degrees((0,) * self.count)


def _of_all(p: Any, count: int) -> BoundedPolynomial:
    return p if isinstance(p, BoundedPolynomial) else BoundedPolynomial.constant(np.full(count, float(p)))


def _exact(p: Any) -> ExactPolynomial:
    return p if isinstance(p, ExactPolynomial) else ExactPolynomial([int(p)])
