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
# A car turns left at right angle while climbing. Its recording becomes a spiral-helix, gets its natural trihedral,
# and its boundary velocities are tuned until a longer vehicle with standing passengers could drive the turn: until
# the limits of curvature and lateral acceleration hold at *every* instant, which a certificate proves.
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
# Uniform rotation is the model of the paper; a polynomial angle, the default, follows the recording four times closer.
# The nearer the axis, the sharper the best turn about it. So that a bus gets around, we keep the axis 12 m away, which
# costs some of that closeness. The result says that this bound is active, and what to do if that is not intended.

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
# Direction cosines, quaternion and Gibbs vector say the same three ways. Half-way, the Gibbs vector is the same in
# the world's axes and in the trihedral's: αG = G.

# %%
frame = jax.jit(qt.trihedral)(path, 0.5 * path.duration)
print("α =\n", frame.dcm())
print("λ =", frame.quaternion())
print("G =", frame.gibbs(), "  αG − G =", frame.dcm() @ frame.gibbs() - frame.gibbs())
assert np.allclose(frame.dcm() @ frame.gibbs(), frame.gibbs(), atol=1e-12)
print(f"κ = {frame.curvature:.4f} 1/m, torsion {frame.torsion:.5f} 1/m, ω⁰ = {frame.rate} rad/s")

# %% [markdown]
# ## Limits, before and after
#
# A turning radius of 22.5 m and 1.5 m/s² across the path. The ends stay where they are and the turn keeps its axis;
# the velocities at both ends change as little as possible, in the sense of least squares of their cylindrical
# components.

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
# Samples cannot promise that nothing happens between them. Along a spiral-helix every limit is a polynomial
# inequality in time, and its Bernstein coefficients bound it on whole intervals: "proved" means on the whole path,
# "broken" comes with an instant as witness. The path that was driven is the counterexample.

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
# What was not limited changes too: speed, torsion and the angular rate of the trihedral.

# %%
limits_figure(data, ["speed", "torsion", "angular_rate"])

# %% [markdown]
# ## How the answer depends on the question
#
# Everything is differentiable: here the largest curvature of the fitted turn, as its end velocity changes.


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
