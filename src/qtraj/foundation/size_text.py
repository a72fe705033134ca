"""Format lengths and durations in the unit that suits their size."""

import math

_LENGTHS = ((1e-3, "µm", 1e6), (1.0, "mm", 1e3), (1e3, "m", 1.0), (1e9, "km", 1e-3))
_DURATIONS = ((1e-3, "µs", 1e6), (0.1, "ms", 1e3), (600.0, "s", 1.0), (7200.0, "min", 1 / 60), (864e3, "h", 1 / 3600))

TINY = 1e-8
"""Length [m] below which only rounding errors are printed."""


def length_text(length: float, digits: int = 4) -> str:
    """Return a length [m] with its unit, for example "9.0 m" or "8.12 km"."""
    if 0 < abs(length) < TINY:
        return "less than 0.01 µm"
    return _text(length, digits, _LENGTHS, ("km", 1e-3))


def duration_text(duration: float, digits: int = 4) -> str:
    """Return a duration [s] with its unit, for example "12.5 s" or "83 h"."""
    return _text(duration, digits, _DURATIONS, ("days", 1 / 86400))


def _text(value: float, digits: int, units: tuple[tuple[float, str, float], ...], last: tuple[str, float]) -> str:
    """Return `value` with the first unit whose bound is larger, and with at most `digits` significant digits.

    A value that is not finite has no unit: "unknown" (NaN), "infinite" or "-infinite".
    """
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else "infinite" if value > 0 else "-infinite"
    base = next(symbol for _, symbol, factor in units if factor == 1)
    if value == 0:
        return f"0 {base}"
    symbol, factor = next(((symbol, factor) for bound, symbol, factor in units if abs(value) < bound), last)
    number = value * factor
    text = f"{number:.{digits}g}" if abs(number) < 1e6 else f"{number:.3e}"
    if "e+" in text and abs(number) < 1e6:
        text = f"{number:.0f}"
    return f"{text}.0 {symbol}" if (whole := text.lstrip("-")).isdigit() and len(whole) == 1 else f"{text} {symbol}"
