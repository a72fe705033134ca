# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # The fastest lap of a circuit
#
# `qt.retime` finds the fastest timing along a given line. On a road with some width, another line is faster: it uses
# the whole width to reduce the curvature of the bends. `qt.tune_route` with `closed=True` and `objective="fastest"`
# changes the line and its timing together, and proves that every limit is satisfied on the whole lap.

# %%
# %matplotlib inline
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np

import qtraj as qt

jax.config.update("jax_enable_x64", True)

EXAMPLES = next(folder / "examples" for folder in (Path.cwd(), *Path.cwd().parents) if (folder / "examples").is_dir())

# %% [markdown]
# ## The centre line
#
# The circuit has straights, a chicane and a hairpin. It is stored as a route of 80 segments, driven at 5 m/s. The
# limits are those of a sports car on a dry road.

# %%
centre = qt.load(EXAMPLES / "circuit.json")
limits = qt.Limits(speed=40.0, lateral_acceleration=9.0, longitudinal_acceleration=5.0)
print(f"{float(centre.length()):.1f} m in {float(centre.duration):.1f} s")
assert qt.certify(centre, limits).holds

# %% [markdown]
# A lap has no first and no last speed. So three laps are retimed without a break, and the second one counts: the limits
# in the bends determine its speeds, not the ends of the drive.


# %%
def lap(route):
    """The duration of the second of three laps, and the speed profile of all three."""
    timed = qt.retime(route + route + route, limits, knots=1024)
    assert timed.certificate.holds
    once = float(route.duration)
    start, end = (float(timed.timing.time(k * once)) for k in (1, 2))
    return end - start, (timed.path, start, end)


slow, drive = lap(centre)
print(f"fastest lap along the centre line: {slow:.3f} s")

# %% [markdown]
# ## The fastest lap
#
# The road is 3 m wide on each side of the centre line. The positions, velocities and accelerations at the joints and
# the durations of all segments are the variables; the last joint has the same state as the first one. The matrix of
# second derivatives is block tridiagonal except for this coupling. So the cost of a step is still proportional to the
# number of segments.

# %%
best = qt.tune_route(centre, limits, tube=3.0, objective="fastest", closed=True)
print(best)
fast = float(best.path.duration)
print(f"fastest lap: {fast:.3f} s, {slow - fast:.3f} s less than along the centre line")
assert best.converged
assert best.certificate.holds
assert fast < 0.85 * slow

# %% [markdown]
# The next lap continues this one without a jump in position, velocity or acceleration:

# %%
laps = best.path + best.path
print(f"largest jump: {np.abs(laps.jumps()).max():.1e}")
assert np.abs(laps.jumps()).max() < 1e-8
assert qt.certify(laps, limits).holds

# %% [markdown]
# Is the timing of this line the fastest one, too? `retime` finds nearly the same duration for it, with many more
# variables for the timing:

# %%
again, _ = lap(best.path)
print(f"the same line retimed: {again:.3f} s, {100 * (again / fast - 1):+.3f} %")
assert abs(again / fast - 1) < 1e-3

# %% [markdown]
# ## The line and its speed
#
# The fastest line uses the whole width: it enters a bend at the outer edge, touches the inner edge, and leaves at the
# outer edge.

# %%
NAMES = ("position", "velocity", "speed", "lateral_acceleration", "longitudinal_acceleration")


def sampled(path, start, end, count=2001):
    """Values along a lap, and the distance driven."""
    times = np.linspace(start, end, count)
    table = qt.evaluate(path, times, NAMES)
    speed = np.asarray(table.speed)
    step = 0.5 * (speed[1:] + speed[:-1]) * np.diff(times)
    return table, np.append(0.0, np.cumsum(step))


table, way = sampled(best.path, 0.0, fast)
middle, middle_way = sampled(*drive)
line = np.asarray(qt.evaluate(centre, np.linspace(0, centre.duration, 2001), ("position", "velocity")).position)
heading = np.gradient(line[:, :2], axis=0)
left = np.stack([-heading[:, 1], heading[:, 0]], axis=1) / np.linalg.norm(heading, axis=1, keepdims=True)

figure, axes = plt.subplots(1, 2, figsize=(12, 4.2), layout="constrained", width_ratios=(1.4, 1))
for side in (-3.0, 3.0):
    axes[0].plot(*(line[:, :2] + side * left).T, color="0.6", lw=0.8)
axes[0].plot(*line[:, :2].T, color="0.6", lw=0.8, ls="--")
points = axes[0].scatter(*np.asarray(table.position)[:, :2].T, c=np.asarray(table.speed), s=4, cmap="viridis")
figure.colorbar(points, ax=axes[0], label="speed [m/s]", shrink=0.8)
axes[0].set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="fastest line within 3 m of the centre line")
axes[1].plot(100 * middle_way / middle_way[-1], middle.speed, color="0.5", label=f"centre line, {slow:.2f} s")
axes[1].plot(100 * way / way[-1], table.speed, color="#0072B2", label=f"fastest line, {fast:.2f} s")
axes[1].set(xlabel="part of the lap [%]", ylabel="speed [m/s]", ylim=(0, None), title="speed")
axes[1].legend(frameon=False)
plt.close(figure)
figure

# %% [markdown]
# The car brakes or accelerates with the full longitudinal acceleration, or turns with the full lateral acceleration,
# nearly everywhere:

# %%
usage = np.maximum(np.asarray(table.lateral_acceleration) / 9.0, np.abs(table.longitudinal_acceleration) / 5.0)
print(f"at least 99 % of a limit on {100 * np.mean(usage > 0.99):.0f} % of the time")
assert usage.max() <= 1.0
assert np.mean(usage > 0.99) > 0.7

# %% [markdown]
# ## What a limit and the width are worth
#
# The lap time is differentiable with respect to the limits and the width of the tube (implicit function theorem).


# %%
def time(lateral, longitudinal, width):
    grip = qt.Limits(speed=40.0, lateral_acceleration=lateral, longitudinal_acceleration=longitudinal)
    return qt.tune_route(centre, grip, tube=width, objective="fastest", closed=True).path.duration


slopes = jax.grad(time, (0, 1, 2))(9.0, 5.0, 3.0)
for name, slope, unit in zip(("lateral", "longitudinal", "width"), slopes, ("m/s²", "m/s²", "m"), strict=True):
    print(f"{name:12s} {float(slope):+.3f} s per {unit}")
    assert slope < 0
wider = float(time(9.0, 5.0, 3.1)) - fast
print(f"0.1 m more on each side: {wider:+.4f} s, by the derivative {0.1 * float(slopes[2]):+.4f} s")
assert abs(wider - 0.1 * slopes[2]) < 0.2 * abs(wider)

# %% [markdown]
# `python -m benchmarks.circuit` compares the lap with the solution of IPOPT for the same problem; see
# [how to find the fastest lap](../docs/howto/routes.md#the-fastest-lap-of-a-circuit).
