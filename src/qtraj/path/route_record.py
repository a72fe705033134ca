"""Describe the segments of a route as labelled quantities."""

from typing import Any

import numpy as np

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, extent


def record(route: Any, count: int) -> Record:
    """Return the first `count` segments of a route, which are all but the padding."""
    starts, c = np.asarray(route.starts)[..., :count], np.asarray(route.coefficients)[..., :count, :, :]
    variable = "t − start" if route.progress is None else "progress"
    meaning = f"coefficients relative to the origin, world axes; the coefficient of ({variable})^k is in m s^-k"
    variables = {
        "start": Quantity(starts, "s", "time at which a segment starts", ("segment",)),
        "coefficients": Quantity(c, "m", meaning, ("segment", "power", "world")),
        "duration": Quantity(route.duration, "s", "duration of the path"),
        "origin": Quantity(route.origin, "m", "origin of the coefficients, world axes", ("world",)),
    }
    if route.progress is not None:
        own = np.asarray(route.progress)[..., :count, :]
        meaning = "progress along the curve of a segment; the coefficient of (t − start)^k is in s^(1-k)"
        variables["progress"] = Quantity(own, "s", meaning, ("segment", "power_of_time"))
    shape = f"{count} segments of degree {c.shape[-2] - 1}, {extent(route.duration, 's')}"
    return Record(f"{batch_prefix(route.duration.shape)}{shape}", variables, attributes={"frame": "world"})
