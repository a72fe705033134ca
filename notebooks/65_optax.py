# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Tuning by hand with optax
#
# `tune` accepts any optax optimiser. You can also write the loop yourself, because every function of qtraj is a
# differentiable JAX function: a penalty, `jax.value_and_grad`, and `optax.adam`. This notebook does both for the same
# turn, compares them, and says when each is worth it.

# %%
# %matplotlib inline
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pandas
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.viz.style import frame, series

# %% [markdown]
# ## The turn
#
# A vehicle drives around a corner in 6.5 s. With its boundary velocities, the turn is too sharp, and too fast for the
# limit on the lateral acceleration. Which smallest changes of the velocities satisfy both limits?

# %%
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.0, -1.0, 0.1])
DURATION = 6.5
BOUNDS = {"curvature": 0.046, "lateral_acceleration": 1.9}  # [1/m], [m/s²]
limits = qt.Limits(**BOUNDS)


def path_of(change):
    """Return the path with changed velocities [m/s] at both ends, and a changed logarithm of the duration."""
    start = qt.BoundaryState(START.position, START.velocity + change[:3])
    end = qt.BoundaryState(END.position, END.velocity + change[3:6])
    return qt.SpiralHelix.hermite(start, end, DURATION * jnp.exp(change[6]))


before = qt.certify(path_of(np.zeros(7)), limits)
assert not before.holds
before.status

# %% [markdown]
# ## A loop by hand
#
# The cost is that of `tune`: the squared changes of the velocities, and of the duration relative to a reference speed.
# (`tune` compares cylindrical components, which have the same squares.) Limits become penalties at 33 instants:
# `Limits.margins` returns how far each value is below its limit. `jax.lax.scan` runs all steps in one compiled
# function, and `jax.vmap` maps it over four weights of the penalty.

# %%
SPEED_SQ = float(np.mean([np.sum(np.square(x.velocity)) for x in (START, END)]))


def cost(change):
    return jnp.sum(change[:6] ** 2) + jnp.expm1(change[6]) ** 2 * SPEED_SQ


def violation(change):
    """Return the relative violations of the limits at 33 instants (limits, 33)."""
    path = path_of(change)
    margins = jax.vmap(lambda t: limits.margins(path, t))(jnp.linspace(0.0, path.duration, 33))
    return jnp.stack([jax.nn.relu(-margins[name] / bound) for name, bound in BOUNDS.items()])


def loss(change, weight):
    return cost(change) + weight * jnp.mean(violation(change) ** 2)


optimiser = optax.adam(0.02)


def descend(change, weight):
    def step(state, _):
        change, memory = state
        value, slope = jax.value_and_grad(loss)(change, weight)
        updates, memory = optimiser.update(slope, memory)
        return (optax.apply_updates(change, updates), memory), value

    (change, _), history = jax.lax.scan(step, (change, optimiser.init(change)), length=1500)
    return change, history


WEIGHTS = (1e3, 1e4, 1e5, 1e6)
begun = time.perf_counter()
changes, histories = jax.block_until_ready(jax.jit(jax.vmap(descend, (None, 0)))(jnp.zeros(7), jnp.array(WEIGHTS)))
print(f"four penalties, with compilation: {time.perf_counter() - begun:.2f} s", file=sys.stderr)
rows = {}
for weight, change in zip(WEIGHTS, changes, strict=True):
    proof = qt.certify(path_of(change), limits)
    rows[f"penalty × {weight:g}"] = {
        "cost [m²/s²]": float(cost(change)),
        "worst value over its limit": max(float(v / b - 1) for _, v, b in proof.worst.values()),
        "proved": bool(proof.holds),
    }

# %% [markdown]
# ## The built-in search
#
# `tune` with an optax optimiser takes the first steps with an augmented Lagrangian instead of a penalty. The host's
# solver then continues to the optimum, and `certify` proves the limits at every instant.

# %%
for name, method in {"optax.adam(1e-2)": optax.adam(1e-2), "sqp": "sqp"}.items():
    begun = time.perf_counter()
    best = qt.tune(START, END, limits, motion="hermite", duration=DURATION, method=method)
    print(f"{name}: {time.perf_counter() - begun:.2f} s", file=sys.stderr)
    assert best.converged
    rows[f"tune, {name}"] = {
        "cost [m²/s²]": float(best.objective),
        "worst value over its limit": max(float(v / b - 1) for _, v, b in best.certificate.worst.values()),
        "proved": bool(best.certificate.holds),
    }
compared = pandas.DataFrame.from_dict(rows, orient="index")
compared

# %%
optimum = float(best.objective)
penalties = compared[compared.index.str.startswith("penalty")]
assert not penalties["proved"].any(), "a penalty stops outside the limits"
assert compared["proved"].iloc[-2:].all()
assert np.all(np.diff(penalties["worst value over its limit"]) < 0)
assert penalties["cost [m²/s²]"].iloc[-1] > optimum
np.testing.assert_allclose(compared["cost [m²/s²]"].iloc[-2], optimum, rtol=1e-6)
above = penalties["cost [m²/s²]"].iloc[-1] / optimum - 1
print(f"The largest weight ends {above:.0%} above the optimum.")

figure = Figure(figsize=(7.2, 3.4), layout="constrained")
axes = figure.subplots()
for k, (weight, history) in enumerate(zip(WEIGHTS, histories, strict=True)):
    axes.plot(np.arange(history.size), history, **series(k), label=f"penalty × {weight:g}")
axes.axhline(optimum, color="0.4", linestyle=":", label="optimum, proved")
axes.set_yscale("log")
axes.legend()
axes.set(xlabel="step", ylabel="loss [m²/s²]")
frame(axes)
figure

# %% [markdown]
# A penalty stops a little outside the limits, where the gradients of the cost and of the penalty are in balance. A
# larger weight reduces the violation, but makes the descent slower: after 1500 steps, the largest weight has a higher
# cost than the optimum, and still violates the limits. No weight gives a path that is proved. Stricter limits in the
# loss would, at the price of a cost above the optimum.
#
# ## When is each worth it?
#
# - **`tune(…)`**, with its default "sqp", for one problem and for batches on a CPU: exact optimum, proof, and nothing
#   to compile.
# - **`tune(…, method=optax.adam(1e-2), starts=64)`** for large batches with many starts, above all on an accelerator:
#   the first steps are one compiled function; results, proofs and derivatives are the same.
# - **A loop by hand** where the path is one part of a larger loss, for example with a network that proposes the
#   velocities ([learning](../docs/howto/learning.md)), or where the problem is not one that `tune` knows. Prove the
#   result with `certify`, or let `tune` start from it.
