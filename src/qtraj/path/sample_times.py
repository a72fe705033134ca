"""Choose instants at which a path or a motion is sampled, by their number or by the time between them."""

from __future__ import annotations  # so that `help` shows short names

import numpy as np
from jaxtyping import Float
from typing_extensions import TypeAliasType

from qtraj.foundation.seconds import seconds

SAMPLES = 25
"""Default number of instants."""

MAX_INSTANTS = 1_000_000
"""Maximum number of instants; a larger number is probably a mistake."""

ROUNDING = 1e-9
"""A multiple of the step that is before the duration by at most this fraction of the duration is omitted."""

Instants = TypeAliasType("Instants", Float[np.ndarray, " n"])


def sample_times(duration: float, samples: int | None = None, step: float | None = None) -> Instants:
    """Return instants [s] from 0 to `duration` [s], both included, in float64.

    `samples` is the number of equally spaced instants. Instead, `step` [s] is the time between two instants; only the
    last interval may be shorter. By default, there are 25 instants.

    **Raises:** ValueError for both `samples` and `step`, for a duration that is negative or not finite, for fewer than
    two samples, for a step that is not positive, and for more than 1 000 000 instants.
    """
    duration, step = float(seconds(duration)), seconds(step)
    if not 0 <= duration < np.inf:
        raise ValueError(f"the duration must be finite and not negative [s], but {duration!r} was given")
    if samples is not None and step is not None:
        raise ValueError("samples and step were both given: pass one of them")
    if step is None:
        return np.linspace(0.0, duration, SAMPLES if samples is None else _count(samples))
    if not (step > 0 and duration / step < MAX_INSTANTS - 1):
        raise ValueError(
            f"step must be positive and result in at most {MAX_INSTANTS} instants, but {step:g} s was given for a path "
            f"of {duration:.6g} s"
        )
    times = step * np.arange(int(duration / step * (1 - ROUNDING)) + 1)  # those before the duration
    return np.append(times, duration) if duration > 0 else times


def _count(samples: int) -> int:
    """Return the number of samples, or raise a ValueError if it is not an integer from 2 to `MAX_INSTANTS`."""
    if samples != int(samples) or samples < 2:
        raise ValueError(f"samples must be an integer, 2 or more, but {samples!r} was given")
    if samples > MAX_INSTANTS:
        raise ValueError(f"samples must be at most {MAX_INSTANTS}, but {samples} was given")
    return int(samples)
