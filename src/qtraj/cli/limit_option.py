"""Parse the option `--limit NAME=VALUE` or `--limit NAME=LOWER:UPPER` of `qtraj route` and `qtraj retime`."""

import math

from qtraj.foundation.suggestion import suggestion

Value = float | tuple[float | None, float | None]
"""A limit on the magnitude, or on two sides of the signed value."""


def limits(texts: list[str] | None) -> dict[str, Value]:
    """Parse the values of the option.

    **Raises:** ValueError for an unknown or repeated name, or a value that is not a number or two numbers.
    """
    from qtraj.path.quantity import QUANTITIES  # imported here, so that --help is fast

    found: dict[str, Value] = {}
    for text in texts or []:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given")
        if name in found:
            raise ValueError(f"--limit {name} was given more than once")
        if name not in QUANTITIES:
            raise ValueError(f"--limit: unknown limit {name!r}; {suggestion(name, list(QUANTITIES), 'limits')}")
        found[name] = _value(name, value, text)
    return found


def _value(name: str, value: str, text: str) -> Value:
    lower, colon, upper = (part.strip() for part in value.partition(":"))
    if not colon:
        limit = _number(value, text)
        if not limit > 0:
            raise ValueError(f"--limit {name} must be positive and finite, but {value} was given")
        return limit
    if not lower and not upper:
        raise ValueError(f"--limit {name} needs a number before or after the colon, but {text!r} was given")
    return _number(lower, text) if lower else None, _number(upper, text) if upper else None


def _number(value: str, text: str) -> float:
    try:
        found = float(value)
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise ValueError(
            "--limit needs NAME=VALUE or NAME=LOWER:UPPER with finite numbers, such as speed=13.9 or "
            f"longitudinal_acceleration=-6:2, but {text!r} was given"
        )
    return found
