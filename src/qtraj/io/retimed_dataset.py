"""Create labelled datasets of a retimed path and the original path (extra `io`)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.limits import Limits, limits_of
from qtraj.design.proof.certificate import Certificate
from qtraj.design.speed_profile import SpeedProfile, speed_profile
from qtraj.design.timing.outcome import Retimed
from qtraj.foundation.record import variable_attributes
from qtraj.io.dataset import path_dataset
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.track import Track

SAMPLES_PER_CELL, MIN_SAMPLES, MAX_SAMPLES = 2, 513, 20_001
"""Number of instants of the dataset for each cell of the timing, and bounds on the total number of instants."""


def retimed_dataset(
    timed: Retimed,
    limits: Limits | None = None,
    certificate: Certificate | None = None,
    profile: SpeedProfile | None = None,
    track: Track | None = None,
    fitted: Fitted | None = None,
    frame: Frame | None = None,
    attributes: Mapping[str, str] | None = None,
    before: AbstractHodograph | None = None,
) -> xarray.Dataset:
    """Create a `path_dataset` of the original path, named "before", and the retimed path, named "after".

    A shape has no times, so its dataset contains only the retimed path. `before` is by default `timed.path.path`, on
    which a vehicle that creeps progresses evenly (see `retime`).

    The variable `reached_share` contains, for each limit, the fraction of the distance on which the limit is reached to
    within 1 %. `limits` and `certificate` may contain additional limits on the shape of the path. By default,
    `certificate` is the certificate of the retiming, and `limits` are the limits of this certificate.
    """
    own = timed.certificate
    given = {name: limit for name, (_, _, limit) in own.worst.items()}
    profile = speed_profile(timed) if profile is None else profile
    cells = np.shape(timed.timing.coefficients)[0]
    dataset = path_dataset(
        ({} if timed.of_shape else {"before": timed.path.path if before is None else before}) | {"after": timed.path},
        limits_of(given, timed.vehicle) if limits is None else limits,
        track,
        samples=int(np.clip(SAMPLES_PER_CELL * cells + 1, MIN_SAMPLES, MAX_SAMPLES)),
        attributes={"retiming_result": timed.result, **(attributes or {})},
        fitted=fitted,
        frame=frame,
        findings={"after": own if certificate is None else certificate},
    )
    share = variable_attributes("1", "fraction of the distance on which the quantity is within 1 % of its limit")
    variables: dict[str, Any] = {"reached_share": ("limit", np.asarray(profile.shares), share)}
    return dataset.assign(variables).assign_coords(limit=("limit", list(profile.names), {"long_name": "limit"}))
