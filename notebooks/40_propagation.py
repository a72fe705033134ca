# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Attitude from a known rate
#
# If the rate ω(t) is known independently of the attitude, 2λ̇ = λ∘ω needs no ODE solver: the rotations of all steps are
# computed at once and multiplied in parallel. The examples are coning, which has a closed form, and a recorded gyro.
#
# The recording is trial 02 of BROAD (Laidig, Caruso, Cereatti, Seel, "BROAD – A Benchmark for Robust Inertial
# Orientation Estimation", Data 6(7):72, 2021), CC BY 4.0; the README in `qtraj/io/data` states which part is used.

# %%
# %matplotlib inline
from importlib.resources import as_file, files

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.viz.figures import orientation_figure, precision_figure

# %% [markdown]
# ## Coning
#
# The body axis moves around a cone of 10° half angle. The rate only oscillates, but the body also has a net rotation.

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


METHODS = {
    "Magnus, order 4": qt.Magnus(4),
    "Magnus, order 6": qt.Magnus(6),
    "Gauss–Legendre, 4 nodes": qt.GaussLegendre(4),
    "Gauss–Legendre, 8 nodes": qt.GaussLegendre(8),
}
WORK = (48, 96, 192)
errors = {}
for name, method in METHODS.items():
    ends = [
        qt.propagate(coning, attitude(0.0), [0.0, 10.0], method, steps=evaluations // len(method.nodes))[-1]
        for evaluations in WORK
    ]
    errors[name] = [float(angle(end, attitude(10.0))) for end in ends]
    print(f"{name:24s} error [rad] at {WORK} evaluations:", *(f"{error:.1e}" for error in errors[name]))

orders = {name: np.log2(error[0] / error[1]) for name, error in errors.items()}
assert abs(orders["Magnus, order 4"] - 4) < 0.3
assert abs(orders["Magnus, order 6"] - 6) < 0.5
assert abs(orders["Gauss–Legendre, 4 nodes"] - 8) < 0.7
assert errors["Gauss–Legendre, 8 nodes"][0] < 1e-9  # 48 evaluations, about 13 for each round of the cone
precision_figure({name: (WORK, e) for name, e in errors.items()}, round_off=1e-15, title="Coning, β = 10°, 10 s")

# %% [markdown]
# Usually you specify a tolerance. The result includes an error estimate.

# %%
answer = qt.propagate_with_estimate(coning, attitude(0.0), [0.0, 3.0, 10.0], tolerance=1e-10)
print(f"{int(answer.steps)} steps, estimate {float(answer.estimate):.1e} rad,", end=" ")
print(f"error {angle(answer.quaternion[-1], attitude(10.0)):.1e} rad")
assert float(angle(answer.quaternion[-1], attitude(10.0))) < 1e-10

# %% [markdown]
# The result can be differentiated with respect to the rate and the initial attitude. The next cell computes the
# derivative of the final attitude with respect to a constant bias of the rate.

# %%
drift = jax.jacfwd(lambda bias: qt.propagate(lambda t: coning(t) + bias, attitude(0.0), [0.0, 10.0])[-1])(jnp.zeros(3))
print("∂λ/∂bias =\n", np.round(drift, 3))
assert np.isfinite(drift).all()

# %% [markdown]
# ## A recorded gyro
#
# The unit is at rest for 14 s, from which we estimate the bias of the gyro. Then we propagate the attitude from one
# optical attitude, with the rates of the gyro. The optical reference shows the remaining error of the sensor.

# %%
with as_file(files("qtraj.io") / "data" / "broad_02_slow_rotation.npz") as path, np.load(path) as file:
    gyro, optical, every = file["gyro"].astype(float), file["quaternion"].astype(float), int(file["every"])
    times, rest = np.arange(len(gyro)) / float(file["sampling_rate"]), int(file["rest"])
bias = gyro[:rest].mean(axis=0)
worst = {}
for name, rates in (("bias removed", gyro - bias), ("bias left in", gyro)):
    found = qt.propagate_samples(times[rest:], rates[rest:], optical[rest // every])[::every]
    gaps = np.degrees(jax.vmap(angle)(found, optical[rest // every :]))
    early = times[rest::every] < times[rest] + 20.0
    print(f"{name}: at most {gaps[early].max():.1f}° in 20 s, {gaps.max():.1f}° in 60 s")
    worst[name] = gaps[early].max()
assert worst["bias removed"] < worst["bias left in"]

# %% [markdown]
# The remaining error is due to the sensor: halving the sampling rate changes the attitude by far less.

# %%
all_samples = qt.propagate_samples(times[rest:], gyro[rest:] - bias, optical[rest // every])
half = qt.propagate_samples(times[rest::2], gyro[rest::2] - bias, optical[rest // every])
gap = np.degrees(angle(all_samples[::2][-1], half[-1]))
print(f"{gap:.3f}° between both at the end")
assert gap < 0.1 * worst["bias removed"]

# %% [markdown]
# The figure shows the attitude from the gyro. Where the body has rotated by 180° from the reference axes, the Gibbs
# vector is infinite; the quaternion remains smooth.

# %%
orientation_figure(times[rest::8], all_samples[::8], title="BROAD, trial 02: slow rotation")
