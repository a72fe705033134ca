"""Quantities of one's own: a function of the motion as an entry of the same kind as those of the registry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from qtraj.foundation.argument import described, require_type
from qtraj.foundation.document import stored_as
from qtraj.foundation.namespace import is_host, xp
from qtraj.path import formula as formulas
from qtraj.path.channel import CHANNELS, MAGNITUDE
from qtraj.path.frenet import Invariants
from qtraj.path.own_expression import Expression
from qtraj.path.own_facts import (
    POSITION,
    Guard,
    OwnFacts,
    axes_of,
    divisor_of,
    is_shape,
    is_zero_at_rest,
    only_height,
    order_of,
    stop_of,
    vectors_of,
)
from qtraj.path.own_motion import NAMES, motion_of, recorded_motion
from qtraj.path.own_name import OwnName
from qtraj.path.own_recording import RecordedNumber, RecordedVector
from qtraj.path.own_units import (
    STATES,
    exponents_of,
    exponents_of_formula,
    exponents_of_function,
    invariants_with,
    text_of,
    unit_of,
)
from qtraj.path.path_quantity import PARAMETERS, WHEELBASE, Component, PathQuantity, squared
from qtraj.path.product import Product, product_of
from qtraj.path.quantity import CORRIDOR, QUANTITIES, SIDES
from qtraj.path.sides import LOWER, UPPER, sides_of

HIGHEST = len(NAMES) - 1
"""Order of the highest derivative that a function can use."""

FIELDS = ("values", "batched", "components", "frame", "axes")
"""The fields of a `Table`."""

TAKEN = {*QUANTITIES, *SIDES, *CHANNELS, CORRIDOR.name, "time", "vehicle", "own", *FIELDS}
"""Names that a quantity of one's own cannot have."""


def _fields(quantity: Any) -> dict[str, Any]:
    known = {"name": quantity.name, "unit": quantity.unit, "expression": _storable_expression(quantity)}
    return known if quantity.meaning == quantity.name else known | {"meaning": quantity.meaning}


def _built(name: str, unit: str, expression: str, meaning: str = "") -> Any:
    require_type(expression, str, f"the expression of the quantity {name}", "a string such as 'velocity[2]'")
    require_type(meaning, str, f"the meaning of the quantity {name}", "a string")
    return Quantity(name, unit, expression, meaning)


def _storable_expression(quantity: Any) -> str:
    """Return the expression of a quantity, from which `load` builds the same quantity.

    **Raises:** ValueError if it has none, or if it is not a valid expression.
    """
    try:
        if quantity.expression is None:
            raise ValueError("its function is not a formula of + - * / and qtraj.sqrt, or is too long")
        if Quantity(quantity.name, quantity.unit, quantity.expression, quantity.meaning) != quantity:
            raise ValueError("its function does not return the same formula each time")
    except ValueError as error:
        raise ValueError(
            f"the quantity {quantity.name} of your own cannot be stored, because {error}: store the other limits, and "
            "add this one after loading them"
        ) from None
    return quantity.expression


@stored_as(_fields, _built)
class Quantity:
    """A quantity along a path, defined by a function of the motion.

    Use it as a key of `Limits(own={quantity: limit})`, in the outputs of `evaluate`, and in `peak`. The function
    returns one number, computed from its argument p: the vectors `p.position`, `p.velocity`, `p.acceleration`, `p.jerk`
    and `p.snap` in world axes, with components `p.velocity[2]` and the methods `dot`, `cross` and `norm`; `p.speed`;
    and the parameters of the vehicle `p.vehicle.mass`, `gravity`, `drag` (½ρC_dA/m [1/m]), `rolling`, `wheelbase` and
    `friction` (a pair). In a function that consists of + − × ÷, integer powers, `abs` and `qtraj.sqrt` of these and of
    numbers, limits are proved like those of the registry, see `certify`. Any other function, such as one with
    `jax.numpy.sin`, is called with arrays, and its limits are sampled: `provable` is False.

    On a spiral-helix, the components x and y and the position are not polynomials, so limits on quantities with them
    are sampled. `qtraj.certify` gives a quantity that divides by zero, or takes the root of a negative number, the
    status "undefined". Equal factors cancel before: x / x is 1, also where x is zero.

    Args:
        name: The name, an identifier that no other quantity or output has.
        unit: The unit of the result, such as "m/s^2", "1/m", "N" or "1": a product of powers of m, s, kg, rad, N and W.
        function: The function of the motion p, or an expression such as "velocity[2]": the same names without p, and
            `sqrt` and `abs`.
        meaning: A text for tables and figures, by default the name.

    Raises:
        TypeError: For a function that is not callable.
        ValueError: For a name that is taken, a unit that is not one or differs from that of the function, and a
            function that fails, does not depend on the motion, or does not return one number. A function that adds
            numbers with different units, as in `p.speed + 3.0`, has no unit that can be checked.

    Example:
        >>> import qtraj as qt
        >>> climb = qt.Quantity("climb_rate", "m/s", lambda p: p.velocity[2])
        >>> path = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
        >>> qt.certify(path, qt.Limits(own={climb: (-2.0, 3.0)})).status["climb_rate_max"]
        'proved'
    """

    name: str
    unit: str
    meaning: str
    expression: str | None
    provable: bool
    entries: Mapping[str, PathQuantity]

    def __init__(self, name: str, unit: str, function: Callable[[Any], Any] | str, meaning: str = ""):
        self.name = _name(name)
        require_type(unit, str, f"the unit of the quantity {name}", "a string such as 'm/s^2'")
        if not callable(function := Expression(function) if isinstance(function, str) else function):
            raise TypeError(f"the quantity {name} needs a function of the motion, but {described(function)} was given")
        self.unit, self.meaning, self._function = unit_of(unit), meaning or name, function
        self._formula, self.expression = _recorded(name, function)
        self.provable = self._formula is not None
        entry = self._of_function() if self._formula is None else self._of_formula(self._formula)
        entries = {name: entry} | sides_of([entry])
        base = {key: OwnName(name, self) if x.base else "" for key, x in entries.items()}
        self.entries = {key: replace(x, name=OwnName(key, self), base=base[key]) for key, x in entries.items()}

    def __repr__(self) -> str:
        kind = "" if self.provable else ", provable=False: limits are sampled"
        return f"Quantity({self.name!r}, {self.entries[self.name].label!r}{kind})"

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Quantity) and self._key() == other._key())

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def key(self) -> OwnName:
        """The name, which carries the quantity."""
        return OwnName(self.name, self)

    def _key(self) -> tuple[Any, ...]:
        own = self._function if self._formula is None else self._formula.key()
        return self.name, self.unit, own, self.meaning

    def _of_formula(self, f: Product) -> PathQuantity:
        exponents = exponents_of_formula(f)
        self._require_unit(exponents)
        divisor, divisors = divisor_of(f)
        every = [Guard(x, True, _exponents(x)) for x in divisors]
        every += [Guard(x, False, _exponents(x)) for x in f.radicands()]
        shape, axes = is_shape(f), axes_of(f)
        singular = divisor is not None or bool(every)
        world = bool(axes & {0, 1}) or not only_height(f)
        stop = stop_of(f, shape) if singular else "path"
        facts = OwnFacts(f, exponents is None, world, shape, stop, tuple(every), is_zero_at_rest(f))
        parameters = {x.parts[0] for x in f.factors() if x.kind == "parameter"}
        needs = WHEELBASE if "wheelbase" in parameters else PARAMETERS if parameters else ""
        magnitude = PathQuantity(
            self.name,
            self.name,
            self.unit,
            order_of(f),
            self.meaning,
            numerator=lambda i: formulas.numerator(f, i, 2),
            denominator=(lambda i: formulas.denominator(f, i, 2)) if formulas.has_denominator(f) else None,
            square=lambda i: squared(formulas.value(f, i)),
            divisor=divisor,
            upright=2 in axes,
            needs=needs,
            position=POSITION in vectors_of(f),
            own=facts,
        )
        if f.positive:
            return magnitude
        component = Component(
            magnitude.meaning,
            lambda i: formulas.numerator(f, i),
            (lambda i: formulas.denominator(f, i)) if formulas.has_denominator(f) else None,
            lambda i: formulas.value(f, i),
        )
        return _with_component(magnitude, component)

    def _of_function(self) -> PathQuantity:
        function, name = self._function, self.name

        def value(i: Invariants) -> Any:
            found = function(motion_of(i))
            return np.asarray(found) if is_host(i.S) else xp.asarray(found)

        self._require_unit(exponents_of_function(_checked(name, value), HIGHEST))
        magnitude = PathQuantity(
            name,
            name,
            self.unit,
            HIGHEST,
            self.meaning,
            numerator=lambda i: squared(value(i)),
            needs=PARAMETERS if _uses_vehicle(function) else "",
            position=True,
            own=OwnFacts(None),
        )
        return _with_component(magnitude, Component(magnitude.meaning, value, None, value))

    def _require_unit(self, found: tuple[Any, ...] | None) -> None:
        if found is not None and found != exponents_of(self.unit):
            raise ValueError(
                f"the function of the quantity {self.name} has the unit {text_of(found)}, but the unit "
                f"{self.unit!r} was given"
            )


def _with_component(magnitude: PathQuantity, component: Component) -> PathQuantity:
    name = magnitude.name
    return replace(
        magnitude,
        symbol=f"|{name}|",
        meaning=f"magnitude of {magnitude.meaning}",
        output=name + MAGNITUDE,
        component=component,
    )


def _recorded(name: str, function: Callable[[Any], Any]) -> tuple[Product | None, str | None]:
    """Return the formula of a function and its text, which is None if it is too long; None for other functions."""
    try:
        found = function(recorded_motion())
    except TypeError:
        return None, None
    except ZeroDivisionError as error:
        raise ValueError(f"the function of the quantity {name} divides by zero") from error
    if isinstance(found, RecordedVector | tuple | list | dict | str) or found is None:
        raise ValueError(
            f"the function of the quantity {name} must return one number, such as p.velocity[2], but "
            f"{'a vector' if isinstance(found, RecordedVector) else described(found)} was returned"
        )
    if not isinstance(found, RecordedNumber) or not found.value.exponents:
        raise ValueError(f"the function of the quantity {name} does not depend on the motion p")
    return found.value, found.text


def _checked(name: str, value: Callable[[Invariants], Any]) -> Callable[[Invariants], Any]:
    def checked(i: Invariants) -> Any:
        try:
            found = value(i)
        except Exception as error:  # the function of the user may raise anything
            raise ValueError(f"the function of the quantity {name} fails: {error}") from error
        if found.shape not in ((), (STATES,)) or not np.issubdtype(found.dtype, np.number):
            raise ValueError(
                f"the function of the quantity {name} must return one number for each instant, of shape ({STATES},) "
                f"for {STATES} instants, but an array of shape {found.shape} and type {found.dtype} was returned"
            )
        return found + np.zeros(STATES)

    return checked


def _uses_vehicle(function: Callable[[Any], Any]) -> bool:
    """Return whether a function that is not a formula uses the vehicle."""
    i = invariants_with(HIGHEST, (1.0, 1.0, 1.0))
    i.vehicle = None
    try:
        function(motion_of(i))
    except AttributeError:
        return True
    return False


def _exponents(f: Any) -> tuple[Any, ...] | None:
    return exponents_of_formula(Product(product_of(1).coefficient, {f: 2}))  # type: ignore[union-attr]


def _name(name: Any) -> str:
    require_type(name, str, "the name of a quantity", "a string such as 'climb_rate'")
    if not name.isidentifier():
        raise ValueError(f"the name of a quantity must be an identifier such as 'climb_rate', but {name!r} was given")
    if name in TAKEN or name.endswith((LOWER, UPPER, MAGNITUDE)):
        raise ValueError(
            f"the name {name!r} of a quantity is taken: choose another one, which is no quantity or output and does "
            f"not end in {LOWER}, {UPPER} or {MAGNITUDE}"
        )
    return name
