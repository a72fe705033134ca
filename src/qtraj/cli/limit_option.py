"""Parse the option `--limit NAME=VALUE` of `qtraj route` and `qtraj retime`."""

import math

from qtraj.foundation.suggestion import suggestion


def limits(texts: list[str] | None) -> dict[str, float]:
    """Parse the values of the option.

    **Raises:** ValueError for an unknown or repeated name, or a value that is not a number.
    """
    from qtraj.path.quantity import QUANTITIES  # imported here, so that --help is fast

    found: dict[str, float] = {}
    for text in texts or []:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given")
        if name in found:
            raise ValueError(f"--limit {name} was given more than once")
        if name not in QUANTITIES:
            raise ValueError(f"--limit: unknown limit {name!r}; {suggestion(name, list(QUANTITIES), 'limits')}")
        try:
            found[name] = float(value)
        except ValueError:
            raise ValueError(f"--limit needs NAME=VALUE, such as speed=13.9, but {text!r} was given") from None
        if not (math.isfinite(found[name]) and found[name] > 0):
            raise ValueError(f"--limit {name} must be positive and finite, but {value} was given")
    return found
