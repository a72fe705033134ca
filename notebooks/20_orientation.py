# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Orientation and its singularities
#
# Attitudes form a curved space of three dimensions. By a theorem of topology, no three numbers describe it smoothly
# everywhere. So every description by three numbers has attitudes at which the description or its derivative is infinite
# or jumps. Quaternions have four numbers and no such attitude, but λ and −λ represent the same attitude.
#
# A second kind of singularity is independent of the description: the natural trihedral of a path does not exist where
# the path is straight or the vehicle stops. There you need another frame, not another description. This notebook shows
# both kinds.

# %%
# %matplotlib inline
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.figures import orientation_figure, path_figure

rotation, quaternion = qt.rotation, qt.quaternion

# %% [markdown]
# ## One attitude, many descriptions
#
# The example is a rotation by 40° to the left (about z), then 20° nose down (about the new y). The whole library uses
# one convention: λ is scalar first and maps body components to inertial components, $v_\xi=\lambda\circ
# v_X\circ\lambda^{-1}$; the direction cosines α map in the opposite direction. Read actively, the same λ rotates the
# inertial axes into the body axes.

# %%
q = rotation.from_euler("ZYX", jnp.radians(jnp.array([40.0, 20.0, 0.0])))
alpha = rotation.to_dcm(q)
for name, value in {
    "quaternion λ": q,
    "Gibbs vector G": rotation.to_gibbs(q),
    "modified Rodrigues": rotation.to_mrp(q),
    "rotation vector Φe [°]": jnp.degrees(rotation.to_rotation_vector(q)),
    "Euler ZYX [°]": jnp.degrees(rotation.to_euler(q, "ZYX")),
    "direction cosines α": alpha,
}.items():
    print(f"{name:24s}", np.array2string(np.asarray(value), precision=4, suppress_small=True, prefix=" " * 25))

forward = jnp.array([1.0, 0.0, 0.0])
assert np.allclose(alpha @ quaternion.rotate(q, forward), forward, atol=1e-15)  # out and back again
assert float(quaternion.rotate(q, forward)[2]) < 0  # nose down: z is up
assert np.allclose(rotation.to_dcm(-3.0 * q), alpha, atol=1e-15)  # λ and cλ are one attitude
assert np.allclose(alpha @ rotation.to_gibbs(q), rotation.to_gibbs(q), atol=1e-15)  # G is the same in both axes

# %% [markdown]
# ## Where each description fails
#
# For some special attitudes, and attitudes close to them, we compute the derivative of each description with respect to
# the attitude. The table shows the largest entry of the Jacobian. If the numbers are small, gradients are usable at
# this attitude. If they are huge, the description is close to its singularity. *At* the singular attitudes the library
# always returns a finite derivative, never NaN, so that an optimiser can pass through them. (For the Gibbs vector of a
# rotation by 180°, which has no derivative, it returns 0.)

# %%
DESCRIPTIONS = {
    "Gibbs": rotation.to_gibbs,
    "MRP": rotation.to_mrp,
    "rotation vector": rotation.to_rotation_vector,
    "Euler ZYX": lambda q: rotation.to_euler(q, "ZYX"),
    "cosines": lambda q: rotation.to_dcm(q).ravel(),
}
SPECIAL = {
    "no turn": jnp.array([1.0, 0.0, 0.0, 0.0]),
    "general": q,
    "nose up 90°": rotation.from_euler("ZYX", jnp.radians(jnp.array([30.0, -90.0, 0.0]))),
    "almost nose up": rotation.from_euler("ZYX", jnp.array([0.5, 1e-6 - np.pi / 2, 0.0])),
    "almost half": quaternion.exp(0.5 * (np.pi - 1e-6) * jnp.array([0.6, 0.0, 0.8])),
    "half turn": jnp.array([0.0, 0.6, 0.0, 0.8]),
}


@jax.jit
def steepness(q):
    """The largest entry of each Jacobian."""
    return jnp.stack([jnp.max(jnp.abs(jax.jacfwd(f)(q))) for f in DESCRIPTIONS.values()])


print(f"{'':16s}" + "".join(f"{name:>17s}" for name in DESCRIPTIONS))
table = {name: np.asarray(steepness(attitude)) for name, attitude in SPECIAL.items()}
for name, row in table.items():
    print(f"{name:16s}" + "".join(f"{value:17.3g}" for value in row))
assert np.isfinite(np.stack(list(table.values()))).all()  # no NaN anywhere
assert table["almost half"][0] > 1e11  # the Gibbs vector runs away, and its derivative faster
assert max(table["almost half"][1:3]) < 10
assert table["almost nose up"][3] > 1e5  # and so do Euler angles at the gimbal lock
assert np.stack(list(table.values()))[:, 4].max() < 10  # direction cosines and quaternions never do

# %% [markdown]
# - **Gibbs** $e\tan\Phi/2$: infinite at 180°. The paper calls the Gibbs vector univalent; at Φ = 180° it is not.
# - **MRP** $e\tan\Phi/4$ and **rotation vector** $\Phi e$: finite, but at 180° their direction jumps from $e$ to $-e$,
#   because the shorter rotation changes its sense. The derivative exists on each side, but not at the jump.
# - **Euler angles** ZYX: at pitch ±90° yaw and roll rotate about the same line. The attitude is still recovered
#   correctly, but the two angles are not unique, so the library sets one of them to zero.

# %%
for attitude in SPECIAL.values():
    there = rotation.from_euler("ZYX", rotation.to_euler(attitude, "ZYX"))
    assert np.allclose(rotation.to_dcm(there), rotation.to_dcm(attitude), atol=1e-14)
beyond = quaternion.exp(0.5 * (np.pi + 1e-6) * jnp.array([0.6, 0.0, 0.8]))
close = np.abs(rotation.to_dcm(beyond) - rotation.to_dcm(SPECIAL["almost half"])).max()
apart = np.linalg.norm(rotation.to_rotation_vector(beyond) - rotation.to_rotation_vector(SPECIAL["almost half"]))
print(f"two attitudes {close:.0e} apart; their rotation vectors {apart:.3f} rad apart")
assert close < 1e-5
assert apart > 6

# %% [markdown]
# ## A climbing turn beyond 180°
#
# The path makes one and a half revolutions up a spiral ramp. The natural trihedral rotates with the road. At 180° the
# Gibbs vector tends to infinity and returns from the opposite direction. The quaternion remains smooth if its sign is
# continuous. The sign of a single trihedral is arbitrary; `continuous=True` (or a `FrameProgram`) chooses continuous
# signs.

# %%
ramp = qt.SpiralHelix([12.0, 0.3], [0.0, 0.6], [0.0, 0.8], 1.5 * 2 * np.pi / 0.6)
path_figure(path_dataset({"ramp": ramp}, attributes={"title": "A spiral ramp with its natural trihedral"}), trihedra=13)

# %%
times = jnp.linspace(0.0, ramp.duration, 401)
loose, kept = (
    qt.evaluate(ramp, times, outputs=("quaternion", "defined"), continuous=continuous) for continuous in (False, True)
)
jumps = [int(np.sum(np.sum(t.quaternion[1:] * t.quaternion[:-1], axis=1) < 0)) for t in (loose, kept)]
print(f"sign changes between neighbours: {jumps[0]} of single trihedra, {jumps[1]} with continuous=True")
assert jumps[0] > 0
assert jumps[1] == 0
assert float(jnp.abs(loose.quaternion[:, 0]).min()) < 0.02  # a half turn is passed
orientation_figure(times, kept.quaternion, kept.defined, "Up the ramp: only the Gibbs vector takes offence")

# %% [markdown]
# ## Where the trihedral does not exist
#
# This section shows the second kind of singularity. The path is an S-bend, $y = \sin x$, with constant velocity in x.
# At each inflection point the curvature vanishes and changes its sign, and $\bar n$ and $\bar b$ flip by 180°. At this
# point `defined` is false. A different description of the attitude does not help, but a different frame does:
#
# - `Upright()`: x forward, y horizontal to the left, z up; the frame of a road vehicle. It is singular only on vertical
#   paths.
# - `RotationMinimizing()`: no rotation about the tangent. It is singular only where the speed vanishes.

# %%
bend = qt.Curve(lambda t: jnp.stack([8 * t, 8 * jnp.sin(t), 0 * t]), 2 * np.pi)
here = qt.trihedral(bend, np.pi)
print("at the inflection: curvature", float(here.curvature), " natural trihedral defined:", bool(here.defined))
assert not bool(here.defined)
assert np.isfinite(np.concatenate([here.dcm().ravel(), here.rate, here.acceleration])).all()  # fallback values, no NaN

times = jnp.linspace(0.0, bend.duration, 401)
natural = qt.evaluate(bend, times, outputs=("quaternion", "defined"), continuous=True)
upright = qt.evaluate(bend, times, outputs=("quaternion", "defined"), frame=qt.Upright(), continuous=True)
assert bool(upright.defined.all())
orientation_figure(times, natural.quaternion, natural.defined, "An S-bend: the natural trihedral flips")

# %%
orientation_figure(times, upright.quaternion, upright.defined, "The same S-bend: the upright frame does not")

# %% [markdown]
# ## Close to an inflection
#
# The curvature of a real road never vanishes exactly, but this is not an advantage. Let the S-bend rise and fall by a
# height δ. Then the natural trihedral is defined everywhere but still flips, in a time proportional to δ, and its
# angular rate is proportional to 1/δ. So a limit on the angular rate of the natural frame excludes such paths. The
# rotation-minimizing frame is not affected.


# %%
@jax.jit
def largest_rates(delta):
    curve = qt.Curve(lambda t: jnp.stack([8 * t, 8 * jnp.sin(t), delta * jnp.cos(t)]), 2 * np.pi)
    minimal = qt.FrameProgram(curve, qt.RotationMinimizing(initial=jnp.array([0.0, 0.0, 1.0])))
    instants = jnp.linspace(0.0, curve.duration, 2001)

    def rates(t):
        frames = [qt.trihedral(curve, t, frame).rate for frame in (qt.Natural(), qt.Upright())]
        return jnp.stack([jnp.linalg.norm(rate) for rate in (*frames, minimal(t).rate)])

    return jnp.max(jax.vmap(rates)(instants), axis=0)


print(f"{'δ [m]':>8s}{'natural':>12s}{'upright':>12s}{'minimizing':>12s}   largest rate [rad/s]")
found = {}
for delta in (2.0, 1.0, 0.5, 0.1, 0.02):
    found[delta] = np.asarray(largest_rates(delta))
    print(f"{delta:8.2f}" + "".join(f"{rate:12.3f}" for rate in found[delta]))
assert found[0.02][0] > 4.5 * found[0.1][0] > 15 * found[0.5][0]
assert max(found[0.02][1:]) < 1.01 * max(found[0.5][1:])

# %% [markdown]
# ## Choosing the frame
#
# On half a loop the upright frame is singular where the path is vertical, because "left" is not defined there. The
# natural frame is regular, because the curvature is large. Any frame can be used in a `FrameProgram`, with the same
# feedback.

# %%
loop = qt.Curve(lambda t: jnp.stack([10 * jnp.sin(t), 0.5 * t, 10 * (1 - jnp.cos(t))]), np.pi)
vertical = qt.trihedral(qt.Curve(lambda t: jnp.stack([0 * t, 0 * t, t]), 1.0), 0.5, qt.Upright())
assert not bool(vertical.defined)
steep = {
    name: float(jnp.abs(qt.trihedral(loop, np.pi / 2, frame).rate).max())
    for name, frame in (("natural", qt.Natural()), ("upright", qt.Upright()))
}
print("rate in the steepest point of the looping [rad/s]:", {k: round(v, 2) for k, v in steep.items()})
assert steep["natural"] < 1.1
assert steep["upright"] > 10 * steep["natural"]

program = qt.FrameProgram(loop)


@jax.jit
def kinematics(t):
    """2 λ̄⁰∘dλ⁰/dt and ω⁰, which must agree (C, 1.5)."""
    attitude, slope = jax.jvp(lambda t: program(t).quaternion, (t,), (jnp.ones_like(t),))
    return 2 * quaternion.product(quaternion.conjugate(attitude), slope)[1:], program(t).rate


left, right = jax.vmap(kinematics)(jnp.linspace(0.0, loop.duration, 201))
print(f"λ⁰ and ω⁰ of the looping agree within {float(jnp.abs(left - right).max()):.0e} rad/s")
assert np.allclose(left, right, atol=1e-12)

# %% [markdown]
# ## Summary
#
# | question | answer |
# |---|---|
# | which description for computations? | quaternions; keep the sign continuous |
# | which description for people? | Euler angles away from pitch ±90°, rotation vectors, direction cosines |
# | when is the Gibbs vector useful? | for rotations well below 180°: three numbers, the same in both bases |
# | which frame for a road vehicle? | `Upright()` |
# | which frame for an aircraft, a tool, a camera? | `RotationMinimizing()`, or natural on curved paths |
# | is a frame defined? | `trihedral(...).defined`; `certify` with `angular_rate` proves the whole path |
