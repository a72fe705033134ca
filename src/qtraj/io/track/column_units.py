"""Units in column names: their spellings, and the factors that convert them to SI units."""

import math
import re
from fractions import Fraction
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of a column: `factor` converts its values to s, m, m/s, rad/s, or to degrees for kind "angle"."""

    symbol: str
    kind: str
    factor: Fraction | float


_TABLE = {
    "time": {
        ("s", Fraction(1)): "s sec secs second seconds",
        ("ms", Fraction(1, 10**3)): "ms msec msecs millisecond milliseconds",
        ("µs", Fraction(1, 10**6)): "us usec usecs microsecond microseconds",
        ("ns", Fraction(1, 10**9)): "ns nsec nsecs nanosecond nanoseconds",
        ("min", Fraction(60)): "min minute minutes",
        ("h", Fraction(3600)): "h hr hrs hour hours",
        ("day", Fraction(86400)): "day days",
    },
    "length": {
        ("m", 1.0): "m meter meters metre metres",
        ("mm", 0.001): "mm",
        ("cm", 0.01): "cm",
        ("km", 1000.0): "km",
        ("ft", 0.3048): "ft feet foot",
        ("in", 0.0254): "in inch inches",
        ("mi", 1609.344): "mi mile miles",
        ("nmi", 1852.0): "nmi",
    },
    "speed": {
        ("m/s", 1.0): "m/s mps ms-1 m_s",
        ("mm/s", 0.001): "mm/s mmps mm_s",
        ("cm/s", 0.01): "cm/s cmps cm_s",
        ("km/h", 1 / 3.6): "km/h kmh kph kmph km_h",
        ("mph", 0.44704): "mph mi/h",
        ("ft/s", 0.3048): "ft/s fps ft_s",
        ("kn", 1852 / 3600): "kn kt kts knot knots",
    },
    "angle": {
        ("deg", 1.0): "deg ° degree degrees",
        ("rad", 180 / math.pi): "rad radian radians",
        ("1e-7 deg", 1e-7): "e7 1e7 dege7 1e-7deg deg1e-7",
        ("semicircles", 180 / 2**31): "semicircle semicircles",
    },
    "angular rate": {
        ("rad/s", 1.0): "rad/s radps rad_s",
        ("mrad/s", 0.001): "mrad/s",
        ("deg/s", math.pi / 180): "deg/s °/s dps degps deg_s °_s",
        ("rpm", math.pi / 30): "rpm",
    },
}
SPELLINGS = {
    spelling: Unit(symbol, kind, factor)
    for kind, units in _TABLE.items()
    for (symbol, factor), spellings in units.items()
    for spelling in spellings.split()
}
"""The unit of each spelling, in lower case and as `spelled` returns it."""

NOT_SUFFIXES = {"h", "min", "in", "mi", "day", "days"}
"""Units that a column name must have in brackets: `x_min` is a minimum, `pos_h` a height, `time_of_day` a clock."""

_PER = re.compile(r"(.+?)(s|h)-1")


def spelled(text: str) -> str:
    """Return a unit in the spelling of `SPELLINGS`: `m s^-1` becomes `m/s`, and µ becomes u."""
    plain = re.sub(r"[\s·*^]+", "", text.lower().replace("⁻¹", "-1")).replace("per", "/")
    plain = plain.replace("\u00b5", "u").replace("\u03bc", "u")
    match = _PER.fullmatch(plain)
    return f"{match[1]}/{match[2]}" if match else plain


def unit_of(text: str) -> Unit | None:
    """Return the unit that a text denotes, or None."""
    return SPELLINGS.get(spelled(text))
