# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # Slews and feedback laws compared
#
# Every slew of a spacecraft, a gimbal or a manipulator's wrist raises two questions: which profile should the angle
# follow, and what should be commanded if the body deviates from the program? This notebook compares profiles, then
# feedback laws, then both together with a disturbance and a limited actuator.

# %%
# %matplotlib inline
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt
from qtraj.viz.figures import loops_figure, profiles_figure

control, quaternion = qt.control, qt.quaternion

# %% [markdown]
# ## Slew profiles
#
# All profiles rotate by 90° about one axis, from rest to rest, within 1 °/s and 0.05 °/s²; the S-curve and the septic
# also limit the jerk to 0.01 °/s³. The time-optimal profile is the fastest, but its acceleration has steps, which
# excite flexible modes. Smoother profiles take longer.

# %%
RATE, ACCELERATION, JERK = np.radians([1.0, 0.05, 0.01])
LAWS = {
    "time-optimal": qt.TimeOptimal(RATE, ACCELERATION),
    "S-curve": qt.SCurve(RATE, ACCELERATION, JERK),
    "cubic": qt.Cubic(max_rate=RATE, max_acceleration=ACCELERATION),
    "quintic": qt.Quintic(max_rate=RATE, max_acceleration=ACCELERATION),
    "septic": qt.Septic(max_rate=RATE, max_acceleration=ACCELERATION, max_jerk=JERK),
}
profiles = {name: law.profile(np.pi / 2) for name, law in LAWS.items()}
peaks = {name: [np.degrees(profile.peak(order)[1]) for order in (1, 2, 3)] for name, profile in profiles.items()}
print(f"{'law':14s}{'time [s]':>10s}{'rate [°/s]':>12s}{'acc. [°/s²]':>13s}{'jerk [°/s³]':>13s}")
for name, profile in profiles.items():
    rate, acceleration, jerk = peaks[name]
    jerk = "unbounded" if name in ("time-optimal", "cubic") else f"{jerk:.4f}"  # their acceleration starts with a step
    print(f"{name:14s}{float(profile.duration):10.3f}{rate:12.4f}{acceleration:13.4f}{jerk:>13s}")
    assert rate < 1.0 + 1e-9
    assert acceleration < 0.05 + 1e-9

durations = {name: float(profile.duration) for name, profile in profiles.items()}
assert abs(durations["time-optimal"] - (90 / 1 + 1 / 0.05)) < 1e-9  # Φ/V + V/A = 110 s
assert abs(durations["S-curve"] - (90 / 1 + 1 / 0.05 + 0.05 / 0.01)) < 1e-9  # and A/J more
assert abs(durations["cubic"] - 1.5 * 90) < 1e-9
assert abs(durations["quintic"] - 15 / 8 * 90) < 1e-9
assert abs(durations["septic"] - 35 / 16 * 90) < 1e-9
assert min(durations, key=durations.get) == "time-optimal"
short = LAWS["time-optimal"].profile(np.radians(10.0))  # a turn too short to reach the rate limit
assert abs(float(short.duration) - 2 * np.sqrt(10 / 0.05)) < 1e-9
profiles_figure(profiles, RATE, ACCELERATION, "Five laws for 90° within 1 °/s and 0.05 °/s²")

# %% [markdown]
# **Validity.** A slew about one fixed axis is the shortest in angle, and the fastest if the *norm* of the angular
# acceleration is bounded (a spherical body). With a bound on each component it is not the fastest. For example, a slew
# of 180° about a body axis, with unit inertia and unit torques about three axes, takes $2\sqrt\pi = 3.54491$ s with the
# Euler turn. The optimal motion of Bilimoria and Wie (1993), whose axis varies, takes 3.24308 s.

# %%
half_turn = qt.TimeOptimal(None, 1.0).profile(np.pi)
print(f"180° about a fixed axis: {float(half_turn.duration):.5f} s")
assert abs(float(half_turn.duration) - 3.54491) < 5e-6

# %% [markdown]
# ## Feedback laws at rest
#
# The body must come to rest at the attitude of the program, from errors of 90°, 150° and 179.99°. All laws have the
# same critically damped gains $k_1=2k$, $k_2=k^2$ with $k=1$ 1/s; they differ in the definition of the error:
#
# | law | attitude error | length |
# |---|---|---|
# | `AccelerationLaw` (paper C) | all four components of μ − 1, error linear by design | |
# | `QuaternionFeedback` (Wie and Barba; Yuan) | $2\mu_v$ | $2\sin\Phi/2$ |
# | `GeometricFeedback` (Lee on SO(3); Luh, Fu and Gonzalez) | $\frac12(R_d^TR - R^TR_d)^\vee$ | $\sin\Phi$ |
# | `LogarithmicFeedback` | the rotation vector | $\Phi$ |

# %%
FEEDBACKS = {
    "acceleration law": qt.AccelerationLaw(2.0, 1.0),
    "quaternion": qt.QuaternionFeedback(2.0, 1.0),
    "geometric": qt.GeometricFeedback(2.0, 1.0),
    "logarithmic": qt.LogarithmicFeedback(2.0, 1.0),
}
AXIS, ANGLES = np.array([2.0, -1.0, 2.0]) / 3, np.radians([90.0, 150.0, 179.99])
identity = jnp.array([1.0, 0.0, 0.0, 0.0])
still = qt.EulerTurn(identity, identity, qt.Quintic(duration=8.0))  # no turn at all
starts = jnp.stack([quaternion.exp(jnp.asarray(0.5 * angle * AXIS)) for angle in ANGLES])
times = jnp.linspace(0.0, 32.0, 641)


@eqx.filter_jit
def released(law, starts):
    """The loops from rest at each of these attitudes, side by side."""
    return jax.vmap(lambda q: qt.simulate(still, law, q, jnp.zeros(4), times))(starts)


loops = {name: released(law, starts) for name, law in FEEDBACKS.items()}
found = {
    name: list(zip(loop.settling_time(np.radians(1.0)).tolist(), loop.peak_command.tolist(), strict=True))
    for name, loop in loops.items()
}
print(f"{'':18s}" + "".join(f"{f'from {np.degrees(angle):g}°':>18s}" for angle in ANGLES))
for name, row in found.items():
    print(f"{name:18s}" + "".join(f"{settled:9.2f} s{peak:7.2f}" for settled, peak in row) + "   (to 1°; rad/s²)")

expected = {
    "acceleration law": [(6.39, 1.41), (6.74, 1.93), (6.80, 2.00)],
    "quaternion": [(6.71, 1.41), (7.67, 1.93), (8.15, 2.00)],
    "geometric": [(7.35, 1.00), (10.2, 0.50), (29.6, 0.14)],
    "logarithmic": [(6.51, 1.57), (7.08, 2.62), (7.30, 3.14)],
}
for name, row in expected.items():
    assert np.allclose(found[name], row, atol=0.06), (name, found[name])

# %% [markdown]
# The command of the geometric law decreases towards 180°, where it is zero, so the slew from 179.99° takes half a
# minute. The logarithmic law has the largest command at the largest error, and its command is discontinuous at 180°.
# The law of paper C is the fastest in every case. However, the on-board computer must integrate the norm of μ as an
# additional state, and the sign of λ must be chosen (see below).

# %%
early = times <= 14.0
element = {name: jax.tree.map(lambda x: x[1, early] if x.ndim > 1 else x[1], loop) for name, loop in loops.items()}
closed = {"acceleration law": qt.error_response(FEEDBACKS["acceleration law"], starts[1], jnp.zeros(4), times[early])}
assert float(jnp.abs(element["acceleration law"].error - closed["acceleration law"]).max()) < 1e-9
loops_figure(element, closed, np.radians(1.0), "Four feedbacks, released at rest 150° away")

# %% [markdown]
# ## The error is independent of the program
#
# The error equation of paper C, $\ddot\mu+K_1\dot\mu+K_2(\mu-1)=0$, is the same for any program. So the error during a
# fast slew equals the error at rest to within rounding errors, and the same gains can be used for all programs. (The
# other laws include the same feedforward, so this also applies to them, but they have no closed form.)

# %%
law = FEEDBACKS["acceleration law"]
moving = qt.EulerTurn(quaternion.exp(jnp.array([0.2, 0.7, -0.4])), starts[1], qt.Quintic(duration=8.0))
short_times = jnp.linspace(0.0, 8.0, 161)
errors = {}
for name, program in {"rest": still, "slew": moving}.items():
    begin, rate = control.state_from_error(program(0.0), starts[0], jnp.array([0.0, 0.3, 0.1, -0.2]))
    errors[name] = qt.simulate(program, law, begin, rate, short_times)
gap = float(jnp.abs(errors["rest"].error - errors["slew"].error).max())
command = {name: np.linalg.norm(loop.physical_command[80]) for name, loop in errors.items()}
print(f"errors over rest and over a slew differ by {gap:.0e};", end=" ")
print(f"the commands at 4 s are {command['rest']:.3f} and {command['slew']:.3f} rad/s²")
assert gap < 1e-8
assert abs(command["slew"] - command["rest"]) > 0.01

# %% [markdown]
# ## Two signs of one attitude
#
# λ and −λ represent the same attitude but have different errors, μ and −μ, and the target is μ = 1. From rest the
# nearer sign, μ₀ ≥ 0, is better; with the other sign the error passes near μ = 0, where the gain $1/|\mu|^2$ has a
# pole. With a fast initial rate the other sign can be better. `choose_sign` computes the smallest |μ| for both signs in
# closed form, before the motion starts.

# %%
spin = jnp.concatenate([jnp.zeros(1), jnp.asarray(6.0 * AXIS)])
begin = starts[0]
for name, rate in {"at rest": jnp.zeros(4), "6 rad/s away": spin}.items():
    slope = control.error_rate(still(0.0), begin, rate)
    least = [float(control.least_norm(law, sign * begin, sign * slope)) for sign in (1.0, -1.0)]
    chosen = control.choose_sign(law, still(0.0), begin, rate)
    sign = "λ" if chosen[0] > 0 else "−λ"
    print(f"{name:14s} least |μ| with λ: {least[0]:.3f}, with −λ: {least[1]:.3f}; chosen: {sign}")
    assert (least[0] >= least[1]) == bool(chosen[0] > 0)

# %% [markdown]
# `simulate` therefore starts with the nearer sign, unless `sign="as given"` asks for the other. Here the slew starts
# with an error of 35°, and −λ is given.

# %%
aside = -quaternion.exp(jnp.asarray(0.5 * np.radians(35.0) * AXIS))
short = jnp.linspace(0.0, 12.0, 121)
ways = {sign: qt.simulate(still, law, aside, jnp.zeros(4), short, sign=sign) for sign in ("nearer", "as given")}
for sign, loop in ways.items():
    print(f"sign={sign!r}: up to {np.degrees(loop.angle.max()):.0f}° off, command up to {loop.peak_command:.2f} rad/s²")
assert np.degrees(ways["nearer"].angle.max()) < 35.01
assert np.degrees(ways["as given"].angle.max()) > 100.0

# %% [markdown]
# ## Disturbance, saturation and sampling
#
# This section repeats the slew with a constant disturbance acceleration $d$, an actuator that saturates, and a command
# that is updated ten times per second. The law has no integral term, so a steady-state error remains: $\ddot\mu=0$
# requires $k_2\mu_v=\frac12 d$, and with $\mu_v\approx\frac12\Phi e$ for small angles the error is $\Phi = d/k_2$.

# %%
push = jnp.array([0.0, 0.004, 0.003])  # [rad/s²]
stiff = qt.AccelerationLaw(*control.from_settling_time(4.0, 0.02))
real = qt.simulate(
    moving,
    stiff,
    moving(0.0).quaternion,
    jnp.zeros(4),
    jnp.linspace(0.0, 16.0, 161),
    disturbance=lambda t: push,
    actuator=qt.Actuator(limit=0.25, sampling=0.1),
)
left = float(real.angle[-1])
print(
    real.result,
    f"\nresting error {np.degrees(left):.4f}°, d/k2 = {np.degrees(float(jnp.linalg.norm(push) / stiff.k2)):.4f}°",
)
assert abs(left / float(jnp.linalg.norm(push) / stiff.k2) - 1) < 0.02
loops_figure({"disturbed, limited, 10 Hz": real}, title="A slew of 8 s with all that")

# %% [markdown]
# ## A rigid body with reaction wheels
#
# So far, the acceleration of the body equalled the command. A `RigidBody` obeys Euler's equations. The on-board
# computer calculates the torques with an assumed inertia, and four wheels exert these torques unless they saturate. The
# error equation is then no longer exact: `body.residual` is $\ddot\mu+K_1\dot\mu+K_2(\mu-1)$, and `body.deviation` is
# the distance of the error from its closed form.

# %%
INERTIA = np.array([80.0, 100.0, 120.0])  # [kg m²]
PYRAMID = [[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]
strong, weak = qt.ReactionWheels(PYRAMID, max_torque=1e3), qt.ReactionWheels(PYRAMID, max_torque=12.0)
bodies = {
    "inertia as assumed": qt.RigidBody(INERTIA, INERTIA, [0.0, 0.0, 0.0], strong),
    "inertia 10 % larger": qt.RigidBody(INERTIA, INERTIA / 1.1, [0.0, 0.0, 0.0], strong),
    "and a torque, weak wheels": qt.RigidBody(INERTIA, INERTIA / 1.1, [0.5, 0.0, -0.2], weak),
}
begin, rate = control.place(stiff, moving(0.0), quaternion.exp(jnp.asarray(0.1 * AXIS)), jnp.zeros(3))
on_wheels = {
    name: qt.simulate(moving, stiff, begin, rate, short_times, body=body, sign="as given")
    for name, body in bodies.items()
}
print(f"{'':28s}{'residual':>10s}{'deviation':>11s}{'wheel torque':>14s}")
for name, loop in on_wheels.items():
    residual, deviation = (float(np.linalg.norm(x, axis=1).max()) for x in (loop.body.residual, loop.body.deviation))
    motors = np.gradient(np.asarray(loop.body.momentum), np.asarray(short_times), axis=0)
    print(f"{name:28s}{residual:10.1e}{deviation:11.1e}{np.abs(motors).max():11.1f} N m")
    turning = jax.vmap(quaternion.rotate)(
        loop.quaternion, loop.rate[:, 1:] * INERTIA + loop.body.momentum @ strong.axes
    )  # the whole angular momentum, in inertial axes
    lost = float(jnp.abs(turning - turning[0]).max())
    assert lost < 1e-6 if name != "and a torque, weak wheels" else lost > 1.0
assert float(np.abs(on_wheels["inertia as assumed"].body.deviation).max()) < 1e-8
print(on_wheels["and a torque, weak wheels"].result)
loops_figure(on_wheels, title="A slew of 8 s on reaction wheels")

# %% [markdown]
# ## A sign with memory
#
# Near a half turn both signs of λ are almost equally near. A feedback that uses the nearer sign at each sample
# (half-width 0) follows the noise of the sensor: its command jumps, and the body hardly moves. A law that never changes
# the sign rotates the body all the way back after a disturbance has rotated it by more than a half turn.
# `HystereticLaw` changes the sign only if $\mu_0<-\delta|\mu|$ (Mayhew, Sanfelice and Teel, 2011). We compare the three
# laws with ten noisy measurements per second, for a body that starts at rest with an error of 179.9°, and for a body
# with an error of 20° and the opposite sign of λ.

# %%
LAWS_OF_SIGN = {
    "never changes": qt.HystereticLaw(FEEDBACKS["quaternion"], 0.999),
    "nearer at each sample": qt.HystereticLaw(FEEDBACKS["quaternion"], 0.0),
    "hysteresis, δ = 0.25": qt.HystereticLaw(FEEDBACKS["quaternion"], 0.25),
}
SEEDS = 4
noisy_times = jnp.linspace(0.0, 16.0, 321)


@eqx.filter_jit
def measured(law, begin, seeds):
    """Loops under noise of the attitude sensor, side by side."""

    def one(seed):
        sensor = qt.Sensor(attitude_noise=0.05, key=jax.random.key(seed), sampling=0.1)
        tolerances = {"rtol": 1e-7, "atol": 1e-9, "sign": "as given"}
        return qt.simulate(still, law, begin, jnp.zeros(4), noisy_times, sensor=sensor, **tolerances)

    return jax.vmap(one)(seeds)


def changes(loops):
    """How often the sign changes, over all seeds."""
    q = np.asarray(loops.quaternion)
    return int(np.sum(np.sum(q[:, 1:] * q[:, :-1], axis=-1) < 0))


def travelled(loops):
    """The angle that the body turns through in the first eight seconds, the mean over the seeds [°]."""
    rates = np.linalg.norm(np.asarray(loops.rate)[:, :161, 1:], axis=-1)
    return float(np.degrees(np.mean(np.trapezoid(rates, noisy_times[:161], axis=-1))))


near_half, far_side = (
    quaternion.exp(jnp.asarray(np.radians(179.9) / 2 * AXIS)),
    -quaternion.exp(jnp.asarray(np.radians(20.0) / 2 * AXIS)),
)
results = {}
print(f"{'sign':24s}{'changes near 180°':>20s}{'turned from 20° beside':>26s}")
for name, one_law in LAWS_OF_SIGN.items():
    half, far = (measured(one_law, begin, jnp.arange(SEEDS)) for begin in (near_half, far_side))
    results[name] = changes(half), travelled(far)
    print(f"{name:24s}{results[name][0]:20d}{results[name][1]:25.0f}°")
assert results["nearer at each sample"][0] > 0
assert results["hysteresis, δ = 0.25"][0] == results["never changes"][0] == 0
assert results["never changes"][1] > 200.0
assert results["hysteresis, δ = 0.25"][1] < 60.0

# %% [markdown]
# ## The gripper of a six-joint arm
#
# The same law in inertial axes controls a gripper. Sensors in the joints measure its attitude and rate, the law
# commands its angular acceleration, and the inverse of the geometric Jacobian converts this command to joint
# accelerations. Away from singularities the gripper has the same error as a free body. Here the Stanford arm starts
# with an error of 40°; the dashed line is the closed form for a free body.

# %%
arm = qt.stanford_arm()
joints = jnp.array([0.3, -0.7, 0.5, 0.4, 0.9, -0.2])  # [rad], the third in [m]
position, attitude = arm.pose(joints)
beside = qt.rotation.from_rotation_vector(jnp.array([0.4, -0.3, 0.5]))
onwards = qt.rotation.from_rotation_vector(jnp.array([-0.3, 0.8, 0.4]))
wrist = qt.EulerTurn(
    quaternion.product(beside, attitude), quaternion.product(attitude, onwards), qt.Septic(duration=4.0)
)
gripper_law = qt.AccelerationLaw(*control.from_settling_time(3.0), error="inertial")
arm_times = jnp.linspace(0.0, 4.0, 41)
motion = qt.simulate_arm(arm, wrist, gripper_law, joints, jnp.zeros(6), arm_times)
first = wrist(0.0)
mu = control.error_quaternion(first, motion.quaternion[0], "inertial")
mu_rate = control.error_rate(first, motion.quaternion[0], motion.rate[0], "inertial")
closed = qt.error_response(gripper_law, mu, mu_rate, arm_times)
expected = 2 * np.arctan2(np.linalg.norm(closed[:, 1:], axis=1), np.abs(closed[:, 0]))
gap = float(np.abs(motion.angle - expected).max())
print(f"error at the start {np.degrees(motion.angle[0]):.1f}°, at the end {np.degrees(motion.angle[-1]):.2f}°")
print(f"largest difference from the closed form: {gap:.0e} rad")
print(f"joints at the end: {np.round(motion.joints[-1], 3)}")
assert gap < 1e-6

# %% [markdown]
# ## Position and attitude together
#
# A vehicle can also follow a path in position. A linear law of the same form acts on the position error, and one dual
# quaternion represents the pose error. Position and attitude errors have closed forms for any path and program.

# %%
path = qt.SpiralHelix([8.0, 0.3, 0.1], [0.4, 0.5, 0.05], [1.0, 0.4, -0.2, 0.03], 2.5)
pose = qt.PoseProgram(path, qt.FrameProgram(path, qt.Upright()))
pose_law = qt.PoseLaw(qt.AccelerationLaw(*control.from_settling_time(2.0)), 6.0, 9.0)
place, attitude = pose(0.0)
away = place[0] + jnp.array([0.5, -0.3, 0.2]), place[1]
tilted = quaternion.product(attitude.quaternion, qt.rotation.from_rotation_vector(jnp.array([0.35, -0.2, 0.25])))
pose_times = jnp.linspace(0.0, 2.5, 26)
followed = qt.simulate_pose(pose, pose_law, *away, tilted, jnp.zeros(4), pose_times)
closed = qt.closed_pose(pose, pose_law, *away, tilted, jnp.zeros(4), pose_times)
where, turned = jax.vmap(qt.dual_quaternion.to_pose)(closed)
offset = np.asarray(away[0] - place[0])[:, None] * (1 + 3 * pose_times) * np.exp(-3 * pose_times)  # k1 = 6, k2 = 9
by_hand = np.asarray(jax.vmap(path.position)(pose_times)) + offset.T
gaps = [float(np.abs(a - b).max()) for a, b in ((where, followed.position), (by_hand, followed.position))]
print(f"offset {1e3 * followed.distance[0]:.0f} mm and {np.degrees(followed.angle[0]):.1f}°, at the end", end=" ")
print(f"{1e3 * followed.distance[-1]:.1f} mm and {np.degrees(followed.angle[-1]):.2f}°")
print(f"largest differences from the closed forms: {gaps[0]:.0e} m and {gaps[1]:.0e} m")
assert max(gaps) < 1e-7
assert np.allclose(turned, followed.quaternion, atol=1e-7)
