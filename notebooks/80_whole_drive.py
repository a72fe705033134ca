# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # From a raw drive to a certified bus route
#
# A car drove 7.9 km through Toronto, with nine stops; its position was recorded at 10 Hz. We fit a route to the whole
# drive and compare it with the gyro. Then we find where a city bus would violate its limits on the same route, change
# the route within a tube until every limit is proved to be satisfied, and examine the changes.

# %%
# %matplotlib inline
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import route_figure

EXAMPLES = next(folder / "examples" for folder in (Path.cwd(), *Path.cwd().parents) if (folder / "examples").is_dir())
DRIVE = EXAMPLES / "drive_8km.csv.gz"

# %% [markdown]
# ## The route
#
# `fit_route` chooses the spacing of the joints and the weight on the jerk by cross-validation, which measures how well
# the route predicts held-out intervals of 1.5 s. It detects stops, where the route is exactly at rest, and outliers.

# %%
track = qt.read_track(DRIVE)
fitted = qt.fit_route(track)
route = fitted.path
print(fitted.result)
print(f"{float(route.length()) / 1000:.2f} km in {float(route.duration) / 60:.1f} min; {len(fitted.stops)} stops")
print(f"smoothing {float(fitted.smoothing):.2g} s^5")
assert float(fitted.prediction_error) < 0.009

# %% [markdown]
# The gyro was not used in the fit. The file contains its yaw rate, `track.rates`. Above 3 m/s the yaw rate of the
# upright frame agrees with it (`qt.compare_rates` does the same for any program):

# %%
rms, correlation = float(fitted.rates.rms[0]), float(fitted.rates.correlation[0])
print(f"yaw rate against the gyro: {rms:.4f} rad/s RMS, correlation {correlation:.4f}")
assert rms < 0.012
assert correlation > 0.994

# %% [markdown]
# ## Where a bus violates its limits
#
# Standing passengers keep their balance up to a lateral acceleration of about 1.5 m/s², and the bus drives at most
# 60 km/h, in bends with a radius of 5 m or more. `certify` checks every segment as a whole, not only at samples, and
# the curvature up to the stops: there the route consists of regular curves with a progress.

# %%
limits = qt.Limits(curvature=0.2, speed=60 / 3.6, lateral_acceleration=1.5)
before = qt.certify(route, limits)
for name in before.names:
    spans = before.intervals(name)
    print(f"{before.describe(name)}; violated in {len(spans)} intervals, {sum(b - a for a, b in spans):.0f} s in total")

# %%
dataset = path_dataset({"route": route}, limits, track, samples=8 * route.segments + 1, frame=qt.Upright())
figure = route_figure(dataset.assign_attrs(title="The drive of the car"))
figure

# %% [markdown]
# ## Tuning within a tube
#
# `tune_route` changes the states at all joints and the durations of all segments together, as little as possible,
# within a tube of 0.75 m about the original route, until every limit is proved to be satisfied, also next to the stops.

# %%
tuned = qt.tune_route(route, limits, tube=0.75)
print(tuned.result)
after = qt.certify(tuned.path, limits)
for name in after.names:
    print(after.describe(name), after.status[name])
print(f"duration: {float(route.duration):.0f} s before, {float(tuned.path.duration):.0f} s after")
assert not len(after.broken)

# %%
dataset = path_dataset({"route": tuned.path}, limits, None, samples=8 * route.segments + 1, frame=qt.Upright())
figure = route_figure(dataset.assign_attrs(title="The route of the bus"))
figure

# %% [markdown]
# The route changes mainly at the corners: the bus drives them more slowly, and uses the width of the tube. Elsewhere
# the geometry hardly changes.

# %%
shift = np.linalg.norm(np.asarray(tuned.displacement)[:, :2], axis=1)
print(f"horizontal displacement of the joints: median {np.median(shift):.3f} m, largest {shift.max():.3f} m")
print(f"joints that move by more than 0.1 m: {np.sum(shift > 0.1)} of {len(shift)}")
assert shift.max() < 0.76
