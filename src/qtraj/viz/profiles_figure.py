"""Plot slew profiles: angle, rate and acceleration against time, and the phase plane."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import matplotlib as mpl
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from qtraj.foundation.arrays import as_float
from qtraj.motion.profiles.profile import Profile
from qtraj.viz.style import ACCELERATION_LABEL, ANGLE_LABEL, BAND, BOUND, RATE_LABEL, RC, WIDTH, frame, head, series

HEIGHT = 5.3  # [inch] without a title
SAMPLES = 1001
HEADROOM = 1.12


def profiles_figure(
    profiles: Mapping[str, Profile],
    max_rate: float | None = None,
    max_acceleration: float | None = None,
    title: str = "",
) -> Figure:
    """Plot angle Φ, rate Φ̇ and acceleration Φ̈ of slews against time, and Φ̇ against Φ, all in degrees.

    `profiles` contains profiles by name, such as `qtraj.EulerTurn(...).profile`. The limits `max_rate` [rad/s] and
    `max_acceleration` [rad/s²] are drawn as lines.

    **Raises:** ValueError if `profiles` is empty.
    """
    if not profiles:
        raise ValueError("a figure of profiles needs at least one profile")
    with mpl.rc_context(RC):
        band = BAND if title else 0.0
        height = HEIGHT + band
        figure = Figure(figsize=(WIDTH, height))
        margins = {"top": 1 - (0.35 + band) / height, "bottom": 0.5 / height}
        left = figure.add_gridspec(3, 1, hspace=0.2, left=0.095, right=0.52, **margins)
        right = figure.add_gridspec(1, 1, left=0.615, right=0.975, **margins)
        histories = [figure.add_subplot(left[0])]
        histories += [figure.add_subplot(left[row], sharex=histories[0]) for row in (1, 2)]
        phase = figure.add_subplot(right[0])
        for k, (name, profile) in enumerate(profiles.items()):
            times, values = _sampled(profile)
            for order, axes in enumerate(histories):
                axes.plot(times, values[:, order], label=name, **series(k))
            phase.plot(values[:, 0], values[:, 1], label=name, **series(k))
        for axes, label in zip(histories, (ANGLE_LABEL, RATE_LABEL, ACCELERATION_LABEL), strict=True):
            axes.set_ylabel(label)
            axes.tick_params(labelbottom=axes is histories[2])
        histories[2].set_xlabel("time [s]")
        phase.set_xlabel(ANGLE_LABEL)
        phase.set_ylabel(RATE_LABEL)
        phase.yaxis.set_major_locator(MaxNLocator("auto", steps=(1, 2, 5, 10)))
        for axes in (*histories, phase):
            frame(axes)
        for axes, limit in ((histories[1], max_rate), (histories[2], max_acceleration), (phase, max_rate)):
            _bound(axes, limit)
        figure.align_ylabels(histories)
        handles, labels = phase.get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.06, 1 - band / height), ncols=7, fontsize=8)
        head(figure, title)
    return figure


def _sampled(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s], and angle, rate and acceleration of the slew as the columns of (n, 3), in degrees.

    The times include each switch and the floating-point number just before it, so that jumps are drawn as vertical
    lines. The last sample is just before the end, because the acceleration is already zero at the end.
    """
    switches = np.asarray(profile.switches, float)
    before = np.nextafter(switches, 0.0)
    times = np.unique(np.concatenate([np.linspace(0.0, before[-1], SAMPLES), before, switches[:-1]]))
    return times, np.degrees(np.asarray(_derivatives(profile, as_float(times))))


@eqx.filter_jit
def _derivatives(profile: Profile, times: Float[Array, " n"]) -> Float[Array, "n 3"]:
    return jax.vmap(lambda t: profile.derivatives(t, 2))(times)


def _bound(axes: Any, limit: float | None) -> None:
    """Draw a dotted line at `limit` [rad/s or rad/s²] unless it is None, and at −`limit` if a curve is negative."""
    if limit is None:
        return
    top = float(np.degrees(limit))
    low = min(float(np.nanmin(line.get_ydata())) for line in axes.lines)
    peak = max(float(np.nanmax(np.abs(line.get_ydata()))) for line in axes.lines)
    axes.axhline(top, label="limit" if axes.get_xlabel() == ANGLE_LABEL else None, **BOUND)
    ceiling = HEADROOM * max(top, peak)
    if low < -1e-9 * top:
        axes.axhline(-top, **BOUND)
        axes.set_ylim(-ceiling, ceiling)
    else:
        axes.set_ylim(0, ceiling)
