# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Gradients through whole computations
#
# Every computation, from boundary states to torques and from gains to the motion of a closed loop, is a differentiable
# JAX function. So you can solve inverse problems: find the parameters that explain observed data. We check the
# gradients first. Then we fit three models to data with the same short Levenberg–Marquardt method: the gains of a loop,
# the inertia of a tumbling body, and the path of a recorded car.

# %%
# %matplotlib inline
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import loops_figure, path_figure

RANDOM = np.random.default_rng(60)

# %% [markdown]
# ## From a boundary velocity to a torque
#
# A vehicle drives from A to B. How does the effort of rotating it, $\int|M|^2dt$ with $M=J\varepsilon+\omega\times
# J\omega$ along its upright frame, depend on the velocity at B? The chain is boundary states → path → frame → attitude
# program → torque. `jax.grad` differentiates all of it, and central differences agree within their accuracy.

# %%
A = qt.BoundaryState([20.0, 0.0, 0.0], [0.5, 8.0, 0.5])
INERTIA = jnp.array([600.0, 2500.0, 2800.0])  # [kg m²] about the vehicle's axes
FRACTIONS = jnp.linspace(0.0, 1.0, 101)


@jax.jit
@jax.value_and_grad
def effort(velocity):
    path = qt.SpiralHelix.hermite(A, qt.BoundaryState([0.0, 24.0, 2.0], velocity), 4.5)
    program = qt.FrameProgram(path, qt.Upright())
    torques = jax.vmap(lambda u: qt.dynamics.torque(program(u * path.duration), INERTIA))(FRACTIONS)
    return jnp.trapezoid(jnp.sum(torques**2, axis=1), FRACTIONS * path.duration)


velocity = jnp.array([-9.0, -0.5, 0.5])
value, slope = effort(velocity)
steps = 1e-4 * np.eye(3)
differences = [(effort(velocity + h)[0] - effort(velocity - h)[0]) / 2e-4 for h in steps]
print("∂(effort)/∂V_B:     ", np.asarray(slope))
print("central differences:", np.asarray(differences))
assert np.allclose(slope, differences, rtol=1e-6)
better, _ = effort(velocity - 0.2 * slope / jnp.linalg.norm(slope))
print(f"0.2 m/s along −gradient: effort {value:.4g} → {better:.4g} N²m²s")
assert better < value

# %% [markdown]
# ## A short Levenberg–Marquardt method
#
# The method minimises $|r(x)|^2$. In each step it solves the linearised problem, and accepts the step if the sum of
# squares decreases; otherwise it increases the damping. Forward differentiation computes the Jacobian, one column per
# unknown, in the same compiled function as the residual.
# With independent errors of size σ in the data, $\sigma^2(J^TJ)^{-1}$ is the covariance of the solution.


# %%
def least_squares(residual, x, iterations=16):
    """The minimiser, its covariance, and the RMS of the residual at every iteration."""
    both = jax.jit(jax.jacfwd(lambda x: (residual(x),) * 2, has_aux=True))
    (jacobian, r), damping, history = both(x), 1e-2, []
    for _ in range(iterations):
        history.append(float(jnp.sqrt(jnp.mean(r**2))))
        normal = jacobian.T @ jacobian
        trial = x - jnp.linalg.solve(normal + damping * jnp.diag(jnp.diag(normal)), jacobian.T @ r)
        new_jacobian, new_r = both(trial)
        if new_r @ new_r <= r @ r:
            x, jacobian, r, damping = trial, new_jacobian, new_r, 0.1 * damping
        else:
            damping = 10 * damping
    variance = (r @ r) / (r.size - x.size)
    return x, variance * np.linalg.inv(jacobian.T @ jacobian), history


# %% [markdown]
# ## Gains from a recorded loop
#
# The data are the error quaternion of a slew, recorded twenty times a second with noise. The gains $k_1,k_2$ of the
# loop and a constant disturbance acceleration $d$ are unknown. With a disturbance there is no closed form, so we
# differentiate through the adaptive solver.

# %%
start = qt.quaternion.exp(jnp.array([0.1, -0.4, 0.2]))
slew = qt.EulerTurn(start, qt.quaternion.exp(jnp.array([0.5, 0.3, -0.2])), qt.Quintic(duration=6.0))
begin = qt.quaternion.product(start, qt.quaternion.exp(jnp.array([0.25, -0.1, 0.2])))
times = jnp.linspace(0.0, 8.0, 161)


def loop(x):
    law, push = qt.AccelerationLaw(x[0], x[1]), x[2:]
    return qt.simulate(slew, law, begin, jnp.zeros(4), times, disturbance=lambda t: push, rtol=1e-8, atol=1e-10)


simulated = jax.jit(loop)
TRUE = jnp.array([1.4, 0.9, 0.02, -0.03, 0.01])
NOISE = 2e-3
recorded = simulated(TRUE).error + NOISE * RANDOM.standard_normal((len(times), 4))
GUESS = jnp.array([3.0, 3.0, 0.0, 0.0, 0.0])
found, covariance, history = least_squares(lambda x: (loop(x).error - recorded).ravel(), GUESS)
spread = np.sqrt(np.diag(covariance))
print("RMS:", " → ".join(f"{rms:.2e}" for rms in history[:12]))
for name, true, value, sigma in zip(("k1", "k2", "d1", "d2", "d3"), TRUE, found, spread, strict=True):
    print(f"{name}: {value:9.5f} ± {sigma:.5f}   (true {true:g})")
assert abs(history[-1] / NOISE - 1) < 0.1  # what remains is the noise
assert np.all(np.abs(found - TRUE) < 4 * spread)
loops_figure(
    {"first guess": simulated(GUESS), "fitted": simulated(found), "true": simulated(TRUE)}, title="Gains from a record"
)

# %% [markdown]
# ## Inertia from a tumble
#
# A body tumbles under known torques of two small thrusters at different frequencies, and we read its gyro. The rates
# alone determine the six components of the inertia tensor: the torques determine the scale, and the gyroscopic term
# $\omega\times J\omega$ determines the products of inertia.

# %%
instants = jnp.linspace(0.0, 12.0, 121)


def tensor(x):
    return jnp.array([[x[0], x[3], x[4]], [x[3], x[1], x[5]], [x[4], x[5], x[2]]])


def thrust(t):
    return jnp.stack([0.8 * jnp.sin(1.1 * t), 0.6 * jnp.cos(0.7 * t), 0.5 * jnp.sin(0.4 * t + 1)])


def rates(x):
    def acceleration(t, quaternion, rate):
        free = qt.dynamics.acceleration(thrust(t), rate[1:], tensor(x))
        return jnp.concatenate([jnp.zeros(1), free])

    return qt.integrate(acceleration, [1.0, 0, 0, 0], jnp.array([0, 0.3, -0.4, 0.2]), instants, rtol=1e-8).rate[:, 1:]


TRUE = jnp.array([2.0, 3.1, 3.9, 0.2, -0.15, 0.3])
NOISE = 2e-3  # [rad/s]
gyro = jax.jit(rates)(TRUE) + NOISE * RANDOM.standard_normal((len(instants), 3))
GUESS = jnp.array([3.0, 3.0, 3.0, 0.0, 0.0, 0.0])
found, covariance, history = least_squares(lambda x: (rates(x) - gyro).ravel(), GUESS)
spread = np.sqrt(np.diag(covariance))
print("RMS:", " → ".join(f"{rms:.2e}" for rms in history[:12]))
for name, true, value, sigma in zip(("J11", "J22", "J33", "J12", "J13", "J23"), TRUE, found, spread, strict=True):
    print(f"{name}: {value:8.4f} ± {sigma:.4f} kg m²   (true {true:g})")
assert abs(history[-1] / NOISE - 1) < 0.1
assert np.all(np.abs(found - TRUE) < 4 * spread)

# %% [markdown]
# ## A path from a recorded turn
#
# A recorded car (Boreas, see notebook 10) makes a right-angle turn. `SpiralHelix.between` creates a path from two
# boundary states, which are twelve numbers. The recorded states at the ends are an initial guess, which ignores all
# other samples. We fit the two states to all samples. (`qt.fit` is the complete method: it also determines the axis,
# and uses the recorded velocities with weights.)

# %%
track = qt.read_track(files("qtraj.io") / "data" / "boreas_right_angle.csv").window(1093.5, 1099.5)
origin = track.positions[0]
samples, elapsed = track.positions - origin, track.elapsed
GUESS = jnp.concatenate([samples[0], track.velocities[0], samples[-1], track.velocities[-1]])


def through(x):
    return qt.SpiralHelix.between(qt.BoundaryState(x[:3], x[3:6]), qt.BoundaryState(x[6:9], x[9:]), track.duration)


def offsets(x):
    path = through(x)
    return (jax.vmap(path.position)(elapsed) - samples).ravel()


found, covariance, history = least_squares(offsets, GUESS)
print("RMS per coordinate [m]:", " → ".join(f"{rms:.3f}" for rms in history[:4]))
print("speed at A and B [m/s]:", *(f"{np.linalg.norm(v):.2f}" for v in (found[3:6], found[9:])))
assert history[-1] < 0.5 * history[0]
assert abs(history[-1] - history[-2]) < 1e-6 * history[0]  # it has converged
paths = {"from the recorded ends": through(GUESS), "fitted to all samples": through(found)}
local = qt.Track(elapsed, samples)
path_figure(path_dataset(paths, track=local, attributes={"title": "A path through all samples"}), trihedra=4)

# %% [markdown]
# The next cell computes the largest curvature of the fitted path (at 201 instants), its derivatives with respect to all
# twelve numbers, and from these its uncertainty.


# %%
@jax.jit
@jax.value_and_grad
def sharpest(x):
    path = through(x)
    return jnp.max(jax.vmap(lambda u: qt.trihedral(path, u * path.duration).curvature)(jnp.linspace(0.0, 1.0, 201)))


curvature, slopes = sharpest(found)
print(f"largest curvature {curvature:.4f} ± {np.sqrt(slopes @ covariance @ slopes):.4f} 1/m")
assert 0.03 < float(curvature) < 0.08
