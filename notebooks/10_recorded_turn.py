# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # A recorded turn, tuned
#
# A car turns left at right angle while climbing. Its recording becomes a spiral-helix, gets its natural trihedral, and
# its boundary velocities are tuned until a longer vehicle with standing passengers could drive the turn.
#
# The recording is an excerpt of the Boreas dataset (Burnett et al., "Boreas: A multi-season autonomous driving
# dataset", IJRR 2023), sequence 2021-08-05-13-34, CC BY 4.0.

# %%
from importlib.resources import files

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

import qtraj as qt

# %% [markdown]
# ## From positions to a path
#
# Uniform rotation is the model of the paper; a polynomial angle follows the recording four times closer.

# %%
track = qt.read_track(files("qtraj.io") / "data" / "boreas_right_angle.csv").window(1093.5, 1099.5)
fits = {motion: qt.fit(track, motion=motion) for motion in ("uniform", "hermite")}
for motion, path in fits.items():
    r = path.residual
    print(f"{motion}: {r.horizontal_rms:.3f} m RMS horizontally, {r.vertical_rms:.3f} m vertically")
path = fits["uniform"]

# %% [markdown]
# ## Orientation along the path
#
# Direction cosines, quaternion and Gibbs vector say the same three ways. Half-way, the Gibbs vector is the same in the
# world's axes and in the trihedral's: αG = G.

# %%
frame = qt.trihedral(path, 0.5 * path.duration)
print("α =\n", frame.dcm())
print("λ =", frame.quaternion())
print("G =", frame.gibbs(), "  αG − G =", frame.dcm() @ frame.gibbs() - frame.gibbs())
print(f"κ = {frame.curvature:.4f} 1/m, torsion {frame.torsion:.5f} 1/m, ω⁰ = {frame.rate} rad/s")

# %% [markdown]
# ## Limits, before and after

# %%
limits = qt.Limits(curvature=1 / 22.5, lateral_acceleration=1.5)
best = qt.tune(path.state(0.0), path.state(path.duration), limits, placement=path.placement)
for name in limits.given():
    time, value = qt.peak(path, name)
    print(f"{name} before: {value:.4f} at {time:.2f} s; after: {best.certificate.describe(name)}")
print(best.result)

# %% [markdown]
# ## How the answer depends on the question
#
# Everything is differentiable: here the largest curvature of the fitted turn, as its end velocity changes.


# %%
def largest_curvature(velocity):
    end = qt.BoundaryState(path.position(path.duration), velocity)
    turn = qt.SpiralHelix.hermite(path.state(0.0), end, path.duration, placement=path.placement)
    return qt.peak(turn, "curvature")[1]


print("∂κ_max/∂V_B =", jax.grad(largest_curvature)(path.velocity(path.duration)), "s/m²")

# %% [markdown]
# ## Many instants at once

# %%
table = qt.evaluate(best.path, jnp.linspace(0.0, best.path.duration, 200), continuous=True)
table.to_xarray()
