# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # The fastest timing along a path
#
# How fast may a bus drive along a given path? `qt.retime` keeps the shape of the path and computes the speed. It
# minimises the duration within the limits, and proves that every limit is satisfied on the whole path. This notebook
# explains the mathematics, retimes a corner and a route with a stop, and shows which limit bounds the speed on each
# part of the path. Then it compares the result with a method that imposes limits only at grid points.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import qtraj as qt

jax.config.update("jax_enable_x64", True)

# %% [markdown]
# ## The mathematics in brief
#
# Let r(u) be the path, and let a(u) = u̇² be the squared time derivative of its parameter u. With primes for
# derivatives with respect to u, the chain rule gives
#
# - the velocity √a·r′,
# - the acceleration a·r″ + ½a′·r′,
# - the jerk √a·(a·r‴ + 3/2·a′·r″ + ½a″·r′),
# - the duration ∫ du/√a, which is a convex function of a.
#
# So limits on speed and lateral acceleration are upper bounds on a, and limits on accelerations are convex in (a, a′).
# The limit on the jerk is not convex. In each step it is replaced by a stricter convex constraint. `retime` represents
# a(u) by a cubic spline, and minimises the duration by an interior-point method. In each cell of the spline, r and a
# are polynomials, so every limit is a polynomial inequality. These inequalities are proved, with bounds on rounding
# errors. [The fastest timing along a path](../docs/timing.md) contains the details.
#
# ## A corner from rest
#
# A bus starts at rest, turns left uphill, and leaves with 6 m/s.

# %%
start = qt.BoundaryState([30.0, 0.0, 0.0], [0.0, 10.0, 1.0])
end = qt.BoundaryState([0.0, 45.0, 8.0], [-12.0, 2.0, 0.0])
corner = qt.SpiralHelix.hermite(start, end, duration=6.0)
limits = qt.Limits(speed=8.33, lateral_acceleration=1.5, longitudinal_acceleration=1.2, jerk=0.9)

timed = qt.retime(corner, limits, start_speed=0.0, end_speed=6.0)
print(timed.result)
print(timed.certificate)
assert timed.certificate.holds

# %% [markdown]
# `qt.speed_profile` determines which limit bounds the speed on each part of the path. In the figure, the colour of the
# speed curve shows this limit. The grey area contains speeds that the limits exclude even at constant speed. One of the
# limits is reached on nearly the whole path.

# %%
profile = qt.speed_profile(timed)
for name, share in zip(profile.names, profile.shares, strict=True):
    print(f"{name:26s} reached on {100 * share:4.1f} % of the distance")
assert np.max(profile.usage) <= 1
assert np.mean(np.max(profile.usage, axis=0) > 0.99) > 0.9
profile.plot("A corner from rest")

# %% [markdown]
# The retimed path can be used like any other path. It has the same shape, and you can create an attitude program along
# it.

# %%
path = timed.path
table = qt.evaluate(path, np.linspace(0.0, path.duration, 5), ("position", "speed", "jerk_magnitude"), qt.Upright())
print(np.round(table.speed, 3), "m/s")
assert jnp.allclose(path.position(path.duration), corner.position(corner.duration))
assert jnp.allclose(path.length(), corner.length())
attitude = qt.FrameProgram(path, qt.Upright())(3.0)
print("rate at 3 s:", np.round(attitude.rate, 4), "rad/s")

# %% [markdown]
# ## What a limit costs
#
# The duration is differentiable with respect to the limits. By the envelope theorem, its derivative equals the
# derivative of the Lagrangian at the optimum, so one reverse pass computes the derivatives with respect to all limits.
# The derivative with respect to a limit that is not reached is zero.

# %%
names = ("speed", "lateral_acceleration", "longitudinal_acceleration", "jerk")
values = jnp.array([8.33, 1.5, 1.2, 0.9])


def duration(values):
    return qt.retime(
        corner, qt.Limits(**dict(zip(names, values, strict=True))), start_speed=0.0, end_speed=6.0
    ).duration


slopes = jax.grad(duration)(values)
for k, name in enumerate(names):
    step = 0.02 * values[k]
    difference = (duration(values.at[k].add(step)) - duration(values.at[k].add(-step))) / (2 * step)
    print(f"{name:26s} {100 * 0.01 * values[k] * slopes[k] / timed.duration:+.3f} % of the time for 1 % of the limit")
    assert abs(slopes[k] - difference) < 0.02 * abs(difference) + 1e-3

# %% [markdown]
# ## Violations between grid points
#
# Most methods impose the limits only at the points of a grid. The next cell contains such a method in its simplest
# form: a(u) is linear between n points. The limits on speed and lateral acceleration bound a at each point. The limit
# on the longitudinal acceleration bounds the slope of a, in a forward pass and then in a backward pass.


# %%
def shape(u):
    """|r'|, the lateral acceleration for a = 1, and (r'·r'')/|r'| at the parameters u."""
    rows = np.asarray(jax.vmap(lambda x: corner.derivatives(x, 2))(jnp.asarray(u)))
    r1, r2 = rows[:, 1], rows[:, 2]
    speed = np.linalg.norm(r1, axis=1)
    return speed, np.linalg.norm(np.cross(r1, r2), axis=1) / speed, np.sum(r1 * r2, axis=1) / speed


def on_a_grid(n, speed_limit=8.33, lateral=1.5, longitudinal=1.2):
    """The parameters and values of a at n points; at rest at the start."""
    u = np.linspace(0.0, 6.0, n)
    pace, across, along = shape(u)
    a = np.minimum((speed_limit / pace) ** 2, lateral / across)
    a[0] = 0.0
    step = u[1]
    for k in range(n - 1):
        a[k + 1] = min(a[k + 1], a[k] + step * 2 * (longitudinal - along[k] * a[k]) / pace[k])
    for k in range(n - 1, 0, -1):
        a[k - 1] = min(a[k - 1], a[k] + step * 2 * (longitudinal + along[k] * a[k]) / pace[k])
    return u, a


def between(u, a, samples=4001):
    """The lateral and the longitudinal acceleration at places between the points."""
    fine = np.linspace(0.0, 6.0, samples)[:-1]
    pace, across, along = shape(fine)
    value, slope = np.interp(fine, u, a), np.diff(a)[np.searchsorted(u, fine, side="right") - 1] / u[1]
    return fine, value * across, along * value + 0.5 * slope * pace


for n in (9, 17, 65, 257):
    _, lateral, longitudinal = between(*on_a_grid(n))
    print(
        f"{n:3d} points: lateral {100 * (lateral.max() / 1.5 - 1):+6.2f} %, "
        f"longitudinal {100 * (np.abs(longitudinal).max() / 1.2 - 1):+6.2f} % above the limit"
    )
    assert np.abs(longitudinal).max() > 1.2

# %% [markdown]
# The method checks each limit only at the points. Between them, the accelerations exceed their limits on every grid.
# The result of `retime` is proved to satisfy the same limits everywhere.

# %%
second_order = qt.Limits(speed=8.33, lateral_acceleration=1.5, longitudinal_acceleration=1.2)
proved = qt.retime(corner, second_order, start_speed=0.0)
print(proved.result)
assert proved.certificate.holds

fine, lateral, longitudinal = between(*on_a_grid(9))
sampled = qt.speed_profile(proved)
figure, axes = plt.subplots(1, 2, figsize=(10, 3.2), layout="constrained")
rows = dict(zip(sampled.names, np.asarray(sampled.values), strict=True))
for panel, name, on_grid, limit in (
    (axes[0], "lateral_acceleration", lateral, 1.5),
    (axes[1], "longitudinal_acceleration", np.abs(longitudinal), 1.2),
):
    panel.plot(fine, on_grid, color="#D55E00", label="9 grid points")
    panel.plot(sampled.parameter, rows[name], color="#0072B2", label="retime, proved")
    panel.axhline(limit, color="0.1", lw=1, ls=":")
    panel.vlines(np.linspace(0, 6, 9), 0, 0.04 * limit, color="0.4")
    panel.set(xlabel="parameter u [s]", ylabel=f"{name.replace('_', ' ')} [m/s²]", ylim=(0, None))
axes[0].legend(loc="lower right", frameon=False)
plt.close(figure)
figure

# %% [markdown]
# ## A route with a stop
#
# A route is divided at its stops. Each drive between two stops is timed from rest to rest, and the stop keeps its
# duration. In this example no speeds are prescribed at the ends of the route, so they are as high as the limits allow.

# %%
times = [0.0, 4.5, 14.5, 19.5, 28.0, 33.0]
position = [[-76.0, -2, 0], [-40, 0, 0], [0, 0, 0], [0, 0, 0], [28, 14, 0.5], [40, 52, 1]]
velocity = [[8.0, 0.3, 0], [8, 0, 0], [0, 0, 0], [0, 0, 0], [5, 5.5, 0.2], [0, 8, 0]]
acceleration = [[0.1, 0, 0], [-0.5, 0, 0], [0, 0, 0], [0, 0, 0], [-0.3, 0.4, 0], [0, 0.2, 0]]
route = qt.Route(times, position, velocity, acceleration)

driven = qt.retime(route, qt.Limits(speed=9.0, lateral_acceleration=1.5, longitudinal_acceleration=1.2, jerk=0.9))
print(driven.result)
stops = qt.speed_profile(driven)
(wait,) = np.asarray(stops.stops)
print(f"{float(driven.duration):.2f} s instead of {float(route.duration):.2f} s")
print(f"waiting from {wait[0]:.2f} to {wait[1]:.2f} s")
assert driven.certificate.holds
assert np.isclose(wait[1] - wait[0], 5.0)
stops.plot("A route with a stop")

# %% [markdown]
# ## On the command line
#
# `qtraj retime` does the same for a scenario, and writes the retimed path, the timing as data, this figure and an HTML
# report: see [how to find the fastest timing](../docs/howto/retime.md).
