# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Batches, graphics processors and several devices
#
# Core functions accept one path and one instant, and `jax.vmap` batches them. `qtraj.evaluate` is the function for the
# most common batch: many paths at many instants, in blocks, on all devices. This notebook runs on the devices that JAX
# finds: a GPU if there is one, otherwise the CPU, which is configured as two devices for the sake of the example.

# %%
# %matplotlib inline
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)  # before JAX is first used; it is no matter to a GPU

import qtraj as qt
from qtraj.viz.figures import loops_figure

DEVICES = jax.devices()
print(f"{len(DEVICES)} × {DEVICES[0].device_kind}, by the backend {jax.default_backend()!r}")

# %% [markdown]
# ## A thousand paths
#
# A batch of paths is one path object whose arrays have a leading batch axis; `vmap` of a constructor creates a batch.
# All functions of qtraj accept batches of paths. The batch in this example contains helices that widen and climb; each
# is evaluated at 401 instants.

# %%
PATHS, INSTANTS = 1000, 401
RANDOM = np.random.default_rng(70)
radii, pitches = jnp.asarray(RANDOM.uniform(5.0, 20.0, PATHS)), jnp.asarray(RANDOM.uniform(-1.0, 1.0, PATHS))
DURATION = 6.0


@jax.vmap
def helices(radius, climb):
    return qt.SpiralHelix(jnp.stack([radius, 0.2]), [0.0, 0.5], jnp.stack([0.0, climb]), DURATION)


paths = helices(radii, pitches)
instants = jnp.linspace(0.0, DURATION, INSTANTS)
table = qt.evaluate(paths, instants)
print(repr(paths))
table

# %% [markdown]
# You can also apply `vmap` to any function of one path and one instant, with the same result. Here we compare the
# trihedral of the last path at the last instant.

# %%
last = qt.trihedral(jax.tree.map(lambda x: x[-1], paths), DURATION)
assert np.allclose(table.rate[-1, -1], last.rate, rtol=0, atol=1e-12)
assert np.allclose(table.curvature[-1, -1], last.curvature, rtol=0, atol=1e-12)
last

# %% [markdown]
# ## Peaks without samples
#
# Often only the peaks, integrals or means are needed, not the samples. With `reduce` each block is reduced while it is
# still in the cache, and no samples are stored. Each peak is returned with the time at which it is attained.

# %%
peaks = qt.evaluate(paths, instants, ("speed", "curvature"), reduce="max")
travelled = qt.evaluate(paths, instants, ("speed",), reduce="integral")["speed"]
lengths = jax.vmap(lambda path: path.length())(paths)
print(repr(peaks))
gap = float(jnp.abs(travelled - lengths).max())
print(f"trapezoidal rule over {INSTANTS} instants against quadrature: {gap:.1e} m")
assert np.allclose(peaks["curvature"], table.curvature.max(axis=1), rtol=1e-12)
assert gap < 1e-4
peaks.to_xarray()

# %% [markdown]
# ## Throughput
#
# We measure the time per instant for different numbers of instants, compiled, for the default seven outputs. The
# dispatch dominates small calls, and memory access dominates large calls, unless only peaks are computed. Times differ
# between runs, so they are printed to stderr, which is not stored; [Performance](../docs/performance.md) lists measured
# times.

# %%
COUNTS = (1, 10, 100, 1000)


def seconds(call, rounds=5):
    """The median time of a call that has been compiled."""
    jax.block_until_ready(call())
    times = []
    for _ in range(rounds):
        begun = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


batches = [jax.tree.map(lambda x, n=n: x[:n], paths) for n in COUNTS]
whole = [seconds(lambda some=some: qt.evaluate(some, instants)) for some in batches]
reduced = [seconds(lambda some=some: qt.evaluate(some, instants, reduce="max")) for some in batches]
samples = np.array(COUNTS) * INSTANTS
for count, a, b in zip(COUNTS, 1e9 * np.array(whole) / samples, 1e9 * np.array(reduced) / samples, strict=True):
    print(f"{count:5d} paths: {a:8.0f} ns an instant, {b:8.0f} ns of peaks only", file=sys.stderr)
assert whole[-1] / samples[-1] < whole[0] / samples[0]  # an instant of many is cheaper than one of few

# %% [markdown]
# A compiled function of your own over one instant costs about as much as `evaluate`. The next cell computes the whole
# trihedral at 200 000 instants of one path with `jit(vmap(trihedral))`, and the same outputs with `evaluate`. A direct
# call of `trihedral` runs one compiled function, and takes about a millisecond.

# %%
alone, many = jax.tree.map(lambda x: x[0], paths), jnp.linspace(0.0, DURATION, 200_000)
OUTPUTS = ("dcm", "speed", "curvature", "torsion", "rate", "angular_acceleration", "defined")
own = jax.jit(jax.vmap(qt.trihedral, (None, 0)))
mine, theirs = seconds(lambda: own(alone, many)), seconds(lambda: qt.evaluate(alone, many, OUTPUTS))
direct = seconds(lambda: qt.trihedral(alone, 1.0).rate)
print(f"{1e3 * mine:.0f} ms against {1e3 * theirs:.0f} ms; a direct call: {1e3 * direct:.2f} ms", file=sys.stderr)
assert np.allclose(own(alone, many).rate, qt.evaluate(alone, many, OUTPUTS).rate, rtol=0, atol=1e-12)
assert mine < 4 * theirs

# %% [markdown]
# ## Several devices
#
# Large jobs are divided over all local devices: the paths if their number is divisible by the number of devices,
# otherwise the instants. `devices` selects the devices. The result is one array whose parts remain on the devices that
# computed them. (Two devices of one CPU share its cores, so they are not faster than one device; two GPUs are faster.)

# %%
spread = qt.evaluate(paths, instants, devices=DEVICES)
alone = qt.evaluate(paths, instants, devices=DEVICES[:1])
for name in ("position", "quaternion", "rate"):
    assert np.allclose(getattr(spread, name), getattr(alone, name), rtol=0, atol=1e-12), name
for shard in spread.position.addressable_shards:
    print(f"device {shard.device.id}: paths {shard.index[0].start or 0} to {(shard.index[0].stop or PATHS) - 1}")
assert len(spread.position.sharding.device_set) == len(DEVICES)

# %% [markdown]
# ## A batch of closed loops
#
# `vmap` also applies to adaptive integration: each element of the batch has its own steps. The example has 64 bodies
# with the same attitude error, and gains from soft to stiff; the results have a leading batch axis. With the law of
# paper C the error has a closed form for any program.

# %%
slew = qt.EulerTurn([1.0, 0, 0, 0], qt.quaternion.exp(jnp.array([0.5, 0.3, -0.2])), qt.Quintic(duration=6.0))
begin = qt.quaternion.exp(jnp.array([0.3, -0.2, 0.1]))
times = jnp.linspace(0.0, 16.0, 161)
stiffness = jnp.linspace(0.5, 3.0, 64)


@jax.jit
@jax.vmap
def loops(k):
    """From rest, with critically damped gains."""
    return qt.simulate(slew, qt.AccelerationLaw(2 * k, k**2), begin, jnp.zeros(4), times)


found = loops(stiffness)
settled = found.settling_time(np.radians(1.0))
print(repr(found))
soft, stiff = float(settled[0]), float(settled[-1])
print(f"settled to 1° after {soft:.2f} s with the softest gains, {stiff:.2f} s with the stiffest")
mu, slope = found.error[0, 0], qt.control.error_rate(slew(0.0), begin, jnp.zeros(4))
closed = jax.vmap(lambda k: qt.error_response(qt.AccelerationLaw(2 * k, k**2), mu, slope, times))(stiffness)
assert float(jnp.abs(found.error - closed).max()) < 1e-8
assert bool(found.successful.all())
assert np.all(np.diff(settled) < 0)
shown = {f"k = {float(stiffness[k]):.1f} 1/s": jax.tree.map(lambda x, k=k: x[k], found) for k in (0, 20, 63)}
loops_figure(shown, settled=np.radians(1.0), title="Three of 64 loops")
