"""Choose instants at which a path or a motion is sampled, by their number or by the time between them."""

from __future__ import annotations  # so that `help` shows short names

import numpy as np
from jaxtyping import Float
from typing_extensions import TypeAliasType

SAMPLES = 25
"""Default number of instants."""

MAX_INSTANTS = 1_000_000
"""Maximum number of instants; a larger number is probably a mistake."""

Instants = TypeAliasType("Instants", Float[np.ndarray, " n"])


def sample_times(duration: float, samples: int | None = None, step: float | None = None) -> Instants:
    """Return instants [s] from 0 to `duration` [s], both included, in float64.

    `samples` is the number of equally spaced instants. Instead, `step` [s] is the time between two instants; only the
    last interval may be shorter. By default, there are 25 instants.

    **Raises:** ValueError for both `samples` and `step`, for a step that is not positive, and for more than 1 000 000
    instants.
    """
    duration = float(duration)
    if samples is not None and step is not None:
        raise ValueError("samples and step were both given: pass one of them")
    if step is None:
        count = SAMPLES if samples is None else samples
        if count > MAX_INSTANTS:
            raise ValueError(f"samples must be at most {MAX_INSTANTS}, but {count} was given")
        return np.linspace(0.0, duration, count)
    if not (step > 0 and duration / step < MAX_INSTANTS):
        raise ValueError(
            f"step must be positive and result in at most {MAX_INSTANTS} instants, but {step:g} s was given for a path "
            f"of {duration:.6g} s"
        )
    times = step * np.arange(int(duration / step * (1 + 1e-12)) + 1)
    return times if times[-1] >= duration * (1 - 1e-9) else np.append(times, duration)
