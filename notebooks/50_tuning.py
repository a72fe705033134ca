# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Tuning in batches, and proofs compared with samples
#
# The states at both ends define a turn that is too sharp. Tuning changes the velocities at the ends as little as
# possible, so that the *whole* path satisfies the limit, and the result contains a proof. This notebook tunes a family
# of such turns in one call, compares proofs with samples, tunes random turns, and repeats the search with optax
# optimisers.

# %%
# %matplotlib inline
import sys
import tempfile
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pandas
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.design.tuning.box import box
from qtraj.design.tuning.methods import get_method
from qtraj.design.tuning.model import costs
from qtraj.design.tuning.motions.registry import get_motion
from qtraj.design.tuning.objectives.registry import get_objective
from qtraj.design.tuning.peaks import find_peaks
from qtraj.design.tuning.problem import pose
from qtraj.design.tuning.searches import Curves, searches_of
from qtraj.design.tuning.targets import search_limits
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import tuning_figure
from qtraj.viz.style import frame, series

COUNT = 32
RANDOM = np.random.default_rng(50)

# %% [markdown]
# ## A family of problems in one call
#
# The batch consists of one turn with 32 limits on its curvature. Inputs that differ between problems have a leading
# batch axis, which `jax.vmap` adds; shared inputs are not repeated. The searches run in NumPy, so the first
# call of a batch takes hardly longer than the second. Times differ between runs, so they are printed to
# stderr, which is not stored: run the notebook to see them.

# %%
start = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
end = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
starts = jax.tree.map(lambda x: jnp.broadcast_to(x, (COUNT, 3)), start)
curvatures = jnp.linspace(0.034, 0.074, COUNT)  # [1/m]
limits = jax.vmap(lambda k: qt.Limits(curvature=k))(curvatures)

seconds = []
for _ in range(2):
    begun = time.perf_counter()
    family = qt.tune(starts, end, limits, starts=1)  # from the given states alone
    seconds.append(time.perf_counter() - begun)
print(f"{seconds[0]:.1f} s, and {1e3 * seconds[1] / COUNT:.1f} ms for each problem once compiled", file=sys.stderr)
assert family.converged.all()
assert np.all(family.certificate.holds)
family

# %% [markdown]
# Every result can be converted to a labelled dataset, and each element of the batch is a separate result.

# %%
family.to_xarray()

# %%
chosen = 5
best = family[chosen]
print(best.result)
before = qt.SpiralHelix.hermite(start, end, best.path.duration)
paths = {"before": before, "after": best.path}
given = qt.Limits(curvature=curvatures[chosen])
tuning_figure(path_dataset(paths, given, attributes={"title": f"Curvature within {curvatures[chosen]:.4f} 1/m"}))

# %% [markdown]
# ## What a limit costs
#
# The figure shows the smallest change of the velocities against the limit. A loose limit is inactive; the cost is then
# due only to the change to a uniform rotation. (The derivative of each cost with respect to its limit is also
# available; see notebook 60 and [Limits, proofs, tuning](../docs/tuning.md).)

# %%
cost, binds = family.objective, np.array(["curvature" in outcome.certificate.active for outcome in family])
figure = Figure(figsize=(7.5, 3.4), layout="constrained")
axes = figure.subplots()
axes.plot(curvatures, cost, **series(0), marker="o", ms=3, label="nearest velocities")
axes.axvspan(curvatures[np.argmin(binds)], curvatures[-1], color="0.9", label="the limit does not bind")
axes.set(xlabel="limit of the curvature [1/m]", ylabel="squared change of velocities [m²/s²]")
frame(axes)
axes.legend(frameon=False)
slack = cost[~binds]
assert np.all(np.diff(cost) < 1e-9)  # a looser limit never costs more
assert binds[0]
assert not binds[-1]
assert float(slack.max() - slack.min()) < 1e-9
figure

# %% [markdown]
# ## Proof and samples
#
# Suppose that 10 000 samples satisfy a limit. The peak lies between two of them, so the path can violate a limit that
# every sample satisfies. The certificate proves the polynomial inequality on the whole of [0, T], including rounding.
# Below, the same path is compared with limits within $10^{-8}$ of its peak (relative).

# %%
peak_time, peak = qt.peak(best.path, "curvature")
instants = jnp.linspace(0.0, best.path.duration, 10_000)
sampled = float(qt.evaluate(best.path, instants, ("curvature",), reduce="max")["curvature"])
offsets = np.concatenate([-np.logspace(-8, -14, COUNT // 2), np.logspace(-14, -8, COUNT // 2)])
copies = jax.tree.map(lambda x: jnp.broadcast_to(x, (COUNT, *x.shape)), best.path)
near = qt.certify(copies, jax.vmap(lambda x: qt.Limits(curvature=x))(peak * (1 + jnp.asarray(offsets))))
status = near.status["curvature"]
missed = 1 - sampled / float(peak)
print(f"largest of 10 000 samples: {missed:.1e} below the peak")
for name in ("proved", "undecided", "broken"):
    found = offsets[status == name]
    print(f"{name:10s}{len(found):3d} limits" + (f", from {found[0]:+.1e} to {found[-1]:+.1e}" if len(found) else ""))
assert not np.any((status == "proved") & (offsets < 0))
assert not np.any((status == "broken") & (offsets > 0))
assert set(status[np.abs(offsets) > 1e-10]) == {"proved", "broken"}
assert np.any((status == "broken") & (offsets > -missed))  # every sample keeps this limit, and the path breaks it

# %% [markdown]
# No false statement was proved. In the undecided cases the peak equals the limit up to rounding errors; therefore the
# search in `tune` uses a value just below the limit. Here the error of the samples is small, because the curve is
# smooth. It is large if the curve has a spike that is narrower than the sample spacing; a proof does not depend on
# samples.

# %% [markdown]
# ## Random turns
#
# This section tunes 32 turns between random states. The limit of each turn is 0.7 times the largest curvature of the
# nearest uniform rotation. The problem is not convex, so a search that starts only from the initial states may end in a
# local optimum. We repeat the searches with eight starts each.

# %%
angles, radii = RANDOM.uniform(0.6, 2.5, COUNT), RANDOM.uniform(15.0, 35.0, (2, COUNT))
heights, speeds = RANDOM.uniform(-1, 1, COUNT), RANDOM.uniform(5.0, 9.0, (2, COUNT))
slants = 0.3 * RANDOM.standard_normal((2, COUNT))


def states(angle, radius, height, speed, slant):
    """States at an azimuth, with the velocity slanted against the circle."""
    outwards, along = np.stack([np.cos(angle), np.sin(angle)]), np.stack([-np.sin(angle), np.cos(angle)])
    velocity = speed * (np.sin(slant) * outwards + np.cos(slant) * along)
    position = np.stack([*(radius * outwards), height], axis=-1)
    return jax.vmap(qt.BoundaryState)(jnp.asarray(position), jnp.asarray(np.stack([*velocity, 0 * height], axis=-1)))


first = states(0 * angles, radii[0], 0 * heights, speeds[0], slants[0])
last = states(angles, radii[1], heights, speeds[1], slants[1])


def tuned(first, last, curvatures, starts):
    """The outcomes under a limit of the curvature for each."""
    return qt.tune(first, last, jax.vmap(lambda k: qt.Limits(curvature=k))(curvatures), starts=starts)


sharp = tuned(first, last, jnp.full(COUNT, 10.0), 1).certificate.values[:, 0]  # of the nearest uniform rotations
wanted = 0.7 * sharp
single, turns = (tuned(first, last, wanted, starts) for starts in (1, 8))
print(repr(single), repr(turns), sep="\n")
gains = 1 - turns.objective / single.objective
print(f"Eight starts find a better optimum in {np.sum(gains > 1e-6)} of {COUNT} problems, by up to {gains.max():.2%}.")
assert turns.converged.all()
assert np.all(gains > -1e-6)

# %% [markdown]
# ## With any optax optimiser
#
# By default `tune` uses sequential quadratic programming, "sqp", written for these problems. It also accepts any optax
# optimiser, which takes first steps from every start; "sqp" then continues from the best results. Path and certificate
# are the same. The cell prints the number of steps and, to stderr, the times of the first call, which includes
# compilation, and of the second call.

# %%
limits = qt.Limits(curvature=0.048, lateral_acceleration=2.2)
methods = {"sqp": "sqp", "lbfgs": "lbfgs", "adam": optax.adam(1e-2)}
rows, seconds = {}, {}
for name, method in methods.items():
    seconds[name] = []
    for _ in range(2):
        begun = time.perf_counter()
        found = qt.tune(start, end, limits, method=method, starts=1)
        jax.block_until_ready(found.objective)
        seconds[name].append(time.perf_counter() - begun)
    print(f"{name}: {seconds[name][0]:.1f} s, then {1e3 * seconds[name][1]:.1f} ms", file=sys.stderr)
    assert found.converged
    assert found.certificate.holds
    excess = max(value / limit - 1 for _, value, limit in found.certificate.worst.values())
    rows[name] = {
        "objective [m²/s²]": float(found.objective),
        "worst value over its limit": float(excess),
        "steps": int(found.iterations),
    }
compared = pandas.DataFrame.from_dict(rows, orient="index")
assert np.ptp(compared["objective [m²/s²]"]) < 1e-5 * compared["objective [m²/s²]"].mean()
assert compared["steps"].idxmin() == "sqp"
compared

# %% [markdown]
# All three reach the same objective, and every limit is proved to be satisfied. The first steps of L-BFGS and of Adam
# need only first derivatives; "sqp" needs no more than a few further steps.
#
# ### Step by step
#
# The loop below runs "sqp" and the first steps of the optimisers with an increasing number of steps, and records the
# objective and the largest violation, $\ln(value/limit)$. A run with more steps begins with the same steps.

# %%
batch = (jax.tree.map(lambda x: x[None], state) for state in (start, end))  # searches run in batches: here of one
posed = pose(*batch, get_objective("nearest"), get_motion("uniform"))
searches = searches_of(posed, search_limits(limits, None, 1), *box(posed, (), {}))


def stopped_after(name, steps):
    """The number of steps, the objective and the worst violation of a search that stops after some steps."""
    search = get_method(methods[name], steps, steps)
    ends = search.search(searches, np.zeros((posed.size, 1)))
    curves = Curves(searches, ends.z)
    worst = find_peaks(searches, curves)[1]
    return ends.steps[0], float(posed.scale[0] * costs(searches, ends.z)[0]), max(0.0, worst[0])


history = {}
for name, steps in {"sqp": range(1, 12), "lbfgs": range(5, 305, 10), "adam": range(25, 1025, 25)}.items():
    history[name] = np.array([stopped_after(name, k) for k in steps])
    print(f"{name:6s}{int(history[name][-1, 0]):6d} steps, worst violation {history[name][-1, 2]:.1e}")

# %%
figure = Figure(figsize=(7.5, 3.4), layout="constrained")
left, right = figure.subplots(1, 2)
solution = history["sqp"][-1, 1]
for k, (name, (steps, objective, violation)) in enumerate((name, seen.T) for name, seen in history.items()):
    left.loglog(steps + 1, np.maximum(violation, 1e-10), **series(k), label=name)
    right.loglog(steps + 1, np.maximum(np.abs(objective / solution - 1), 1e-10), **series(k), label=name)
left.set(xlabel="1 + steps", ylabel="worst violation of a limit", title="Limits")
right.set(xlabel="1 + steps", ylabel="relative distance", title="Objective, from the solution")
for axes in (left, right):
    frame(axes)
    axes.legend(frameon=False)
assert history["sqp"][-1, 2] <= 2e-9
assert all(seen[-1, 2] < 1e-2 for seen in history.values())
figure

# %% [markdown]
# The augmented Lagrangian sees the limits only at its nodes, so its points come near the solution and stay there, until
# "sqp" continues. Derivatives of the solution do not involve the search, so they are
# the same as with "sqp".


# %%
def duration(curvature, method):
    """The duration of the tuned path [s]."""
    limited = qt.Limits(curvature=curvature, lateral_acceleration=2.2)
    return qt.tune(start, end, limited, method=method, starts=1).path.duration


slopes = {name: float(jax.jit(jax.grad(duration), static_argnums=1)(0.048, methods[name])) for name in ("sqp", "lbfgs")}
print({name: f"{slope:.6f} s·m" for name, slope in slopes.items()})
assert abs(slopes["lbfgs"] / slopes["sqp"] - 1) < 1e-4

# %% [markdown]
# ## Saving as a table
#
# The suffix of the file name selects netCDF, Zarr, Parquet or CSV, and loading restores all numbers exactly. In Parquet
# and CSV each problem is a row, for pandas and other tools; `qt.load_dataset` also restores units and provenance.

# %%
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "turns.parquet"
    qt.save_dataset(turns, file)
    table = pandas.read_parquet(file)
    again = qt.load_dataset(file)
assert again.identical(turns.to_xarray())
assert np.array_equal(table["objective"], turns.objective)
print(again.attrs["versions"])
table[["outcome", "objective", "iterations", "worst_value_curvature", "bound_curvature", "duration"]].describe()
