# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Attitude from a known rate
#
# Where the rate ω(t) is known without the attitude, 2λ̇ = λ∘ω needs no ODE solver: the turns of all steps are computed
# at once and multiplied in parallel. First coning, which has a closed form; then a recorded gyro.
#
# The recording is trial 02 of BROAD (Laidig, Caruso, Cereatti, Seel, "BROAD – A Benchmark for Robust Inertial
# Orientation Estimation", Data 6(7):72, 2021), CC BY 4.0; tests/data/README.md says what was left out of it.

# %%
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt

# %% [markdown]
# ## Coning
#
# The body's axis runs around a cone of 10° half angle; the rate seems to oscillate only, and yet the body turns.

# %%
BETA, SPEED = np.radians(10.0), 0.74 * np.pi


def coning(t):
    level, phase = SPEED * jnp.sin(BETA), SPEED * t
    return jnp.stack([-level * jnp.sin(phase), level * jnp.cos(phase), -2 * SPEED * jnp.sin(BETA / 2) ** 2 + 0 * t])


def attitude(t):
    half = np.sin(BETA / 2)
    return np.array([np.cos(BETA / 2), half * np.cos(SPEED * t), half * np.sin(SPEED * t), 0.0])


@jax.jit
def angle(p, q):
    """Between two attitudes [rad]."""
    d = qt.quaternion.product(qt.quaternion.conjugate(p), q)
    return 2 * jnp.arctan2(jnp.linalg.norm(d[1:]), jnp.abs(d[0]))


for method in (qt.Magnus(4), qt.Magnus(6), qt.GaussLegendre(8)):
    errors = []
    for evaluations in (48, 96, 192):
        steps = evaluations // len(method.nodes)
        last = qt.propagate(coning, attitude(0.0), [0.0, 10.0], method, steps=steps)[-1]
        errors.append(f"{angle(last, attitude(10.0)):.1e}")
    print(method, "error [rad] at 48, 96, 192 evaluations:", *errors)

# %% [markdown]
# Usually one asks for a tolerance. The estimate is part of the answer.

# %%
answer = qt.propagate_with_estimate(coning, attitude(0.0), [0.0, 3.0, 10.0], tolerance=1e-10)
print(f"{int(answer.steps)} steps, estimate {float(answer.estimate):.1e} rad,", end=" ")
print(f"error {angle(answer.quaternion[-1], attitude(10.0)):.1e} rad")

# %% [markdown]
# The result can be differentiated with respect to the rate and the first attitude: here, how the last attitude answers
# to a constant bias of the rate.

# %%
drift = jax.jacfwd(lambda bias: qt.propagate(lambda t: coning(t) + bias, attitude(0.0), [0.0, 10.0])[-1])(jnp.zeros(3))
print("∂λ/∂bias =\n", np.round(drift, 3))

# %% [markdown]
# ## A recorded gyro
#
# The unit lies still for 14 s, which tells the bias of the gyro. From one optical attitude on, the gyro alone is
# propagated; the optical reference then shows what the sensor leaves.

# %%
folder = next(path for path in (Path("tests/data"), Path("../tests/data")) if path.exists())
with np.load(folder / "broad_02_slow_rotation.npz") as file:
    gyro, optical, every = file["gyro"].astype(float), file["quaternion"].astype(float), int(file["every"])
    times, rest = np.arange(len(gyro)) / float(file["sampling_rate"]), int(file["rest"])
bias = gyro[:rest].mean(axis=0)
for name, rates in (("bias removed", gyro - bias), ("bias left in", gyro)):
    found = qt.propagate_samples(times[rest:], rates[rest:], optical[rest // every])[::every]
    gaps = np.degrees(jax.vmap(angle)(found, optical[rest // every :]))
    early = times[rest::every] < times[rest] + 20.0
    print(f"{name}: at most {gaps[early].max():.1f}° in 20 s, {gaps.max():.1f}° in 60 s")

# %% [markdown]
# What remains is the sensor: halving the rate at which it is read changes the attitude by far less.

# %%
all_samples = qt.propagate_samples(times[rest:], gyro[rest:] - bias, optical[rest // every])
half = qt.propagate_samples(times[rest::2], gyro[rest::2] - bias, optical[rest // every])
print(f"{np.degrees(angle(all_samples[::2][-1], half[-1])):.3f}° between both at the end")
