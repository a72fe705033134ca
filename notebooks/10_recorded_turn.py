# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # A recorded turn, tuned
#
# A car makes a climbing left turn by a right angle. We fit a spiral-helix to its recording and compute the natural
# trihedral. Then we tune the boundary velocities so that a longer vehicle with standing passengers can drive the turn:
# curvature and lateral acceleration satisfy their limits at *every* instant, which a certificate proves.
#
# The recording is an excerpt of the Boreas dataset (Burnett et al., "Boreas: A multi-season autonomous driving
# dataset", IJRR 2023), sequence 2021-08-05-13-34, CC BY 4.0.

# %%
# %matplotlib inline
from importlib.resources import files

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import limits_figure, tuning_figure

# %% [markdown]
# ## From positions to a path
#
# Uniform rotation is the model of the paper; a polynomial angle, the default, follows the recording four times more
# closely. The closer the axis, the sharper the best turn about this axis. To make the turn drivable for a bus, we keep
# the axis at least 12 m away, which makes the fit slightly worse. The result reports that this bound is active, and
# gives advice in case this is not intended.

# %%
track = qt.read_track(files("qtraj.io") / "data" / "boreas_right_angle.csv").window(1093.5, 1099.5)
fits = {
    "uniform": qt.fit(track, motion="uniform"),
    "hermite": qt.fit(track),
    "hermite, at least 12 m from its axis": qt.fit(track, radius_bounds=(12.0, 40.0)),
}
for name, found in fits.items():
    r = found.residual
    print(f"{name}: {r.horizontal_rms:.3f} m RMS horizontally, {r.vertical_rms:.3f} m vertically")
    assert found.successful
uniform, hermite, fit = fits.values()
assert hermite.residual.horizontal_rms < 0.3 * uniform.residual.horizontal_rms
assert fit.residual.horizontal_rms < 0.7 * uniform.residual.horizontal_rms
print(fit.result)
path = fit.path

# %% [markdown]
# ## Orientation along the path
#
# Direction cosines, quaternion and Gibbs vector describe the same attitude. We check at half the duration that the
# Gibbs vector has the same components in world axes and in the axes of the trihedral: αG = G.

# %%
frame = jax.jit(qt.trihedral)(path, 0.5 * path.duration)
print("α =\n", frame.dcm())
print("λ =", frame.quaternion())
print("G =", frame.gibbs(), "  αG − G =", frame.dcm() @ frame.gibbs() - frame.gibbs())
assert np.allclose(frame.dcm() @ frame.gibbs(), frame.gibbs(), atol=1e-12)
print(f"κ = {frame.curvature:.4f} 1/m, torsion {frame.torsion:.5f} 1/m, ω⁰ = {frame.rate} rad/s")

# %% [markdown]
# ## Limits before and after tuning
#
# The limits are a turning radius of 22.5 m and a lateral acceleration of 1.5 m/s². The positions of the ends and the
# axis stay fixed. The velocities at both ends change as little as possible: `tune` minimises the sum of squares of the
# changes of their cylindrical components.

# %%
limits = qt.Limits(curvature=1 / 22.5, lateral_acceleration=1.5)
start, end = path.state(0.0), path.state(path.duration)
best = qt.tune(start, end, limits, motion="hermite", duration=path.duration, placement=path.placement)
for name in limits.given():
    time, value = qt.peak(path, name)
    print(f"{name} before: {value:.4f} at {time:.2f} s; after: {best.certificate.describe(name)}")
    assert value > getattr(limits, name)
print(best.result)
print(f"the turn takes {best.path.duration:.2f} s instead of {path.duration:.2f} s")

# %% [markdown]
# ## The certificate
#
# Samples contain no information about the instants between them. Along a spiral-helix every limit is a polynomial
# inequality in time, and its Bernstein coefficients bound it on whole intervals. "proved" refers to the whole path;
# "broken" is reported with an instant at which the limit is violated. The recorded path violates its limits.

# %%
assert best.certificate.holds
assert set(best.certificate.status.values()) == {"proved"}
driven = qt.certify(path, limits)
for name in limits.given():
    print(f"{name}: as driven {driven.status[name]}, tuned {best.certificate.status[name]}")
    assert driven.status[name] == "broken"
    time, value, limit = best.certificate.worst[name]
    assert value <= limit
    assert value > 0.999 * limit  # the tuned path uses what it is allowed

# %%
data = path_dataset({"before": path, "after": best.path}, limits, track, attributes={"title": "A recorded turn, tuned"})
tuning_figure(data)

# %% [markdown]
# Quantities without a limit also change: speed, torsion and the angular rate of the trihedral.

# %%
limits_figure(data, ["speed", "torsion", "angular_rate"])

# %% [markdown]
# ## Sensitivity to the data
#
# All these computations are differentiable. The next cell computes the gradient of the largest curvature of the fitted
# turn with respect to its end velocity.


# %%
@jax.jit
@jax.value_and_grad
def largest_curvature(velocity):
    end = qt.BoundaryState(path.position(path.duration), velocity)
    turn = qt.SpiralHelix.hermite(path.state(0.0), end, path.duration, placement=path.placement)
    return qt.peak(turn, "curvature")[1]


velocity = path.velocity(path.duration)
_, slope = largest_curvature(velocity)
print("∂κ_max/∂V_B =", slope, "s/m²")
step = 1e-3 * slope / jnp.linalg.norm(slope)
difference = (largest_curvature(velocity + step)[0] - largest_curvature(velocity - step)[0]) / 2e-3
assert np.isclose(difference, jnp.linalg.norm(slope), rtol=1e-5)

# %% [markdown]
# ## Many instants at once

# %%
table = qt.evaluate(best.path, jnp.linspace(0.0, best.path.duration, 200), continuous=True)
assert np.abs(table.curvature).max() <= 1 / 22.5
table.to_xarray()
