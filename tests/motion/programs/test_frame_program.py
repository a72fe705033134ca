"""Frame programs: kinematic identities of every frame, continuity of sign, and the rotation-minimizing frame."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.document import load
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import RotationMinimizing
from qtraj.path.curve import Curve
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import Natural, Upright, trihedral

ROUND_OFF = 3e-13  # of rates and accelerations of size 1 to 10
ORACLE = 1e-11  # of an integration by SciPy at its tightest
GRADIENT = 1e-7  # of central differences, step 1e-5

FRAMES = {"natural": Natural(), "upright": Upright(), "minimizing": RotationMinimizing()}


def polynomial_path(radius, angle, height, orientation=(1.0, 0.0, 0.0, 0.0)):
    """Paths of one structure, so that each function is compiled once."""
    pad = [jnp.pad(jnp.asarray(c), (0, n - len(c))) for c, n in ((radius, 3), (angle, 3), (height, 4))]
    return SpiralHelix(*pad, 8.0, Placement(orientation=orientation))


def spiral(pitch=1.0):
    """Four whole turns with varying radius, rate and height."""
    height = jnp.asarray([0.0, 0.0, 0.3, -0.05]).at[1].set(pitch)
    return polynomial_path([20.0, 0.5, -0.1], [0.3, 3.1, 0.05], height, (1.0, 0.2, -0.1, 0.3))


@jax.jit
def evaluated(program, times):
    """Attitudes, and the residuals of 2λ̇ = λ∘ω and ω̇ = ε."""

    def one(t):
        at, along = jax.jvp(program, (t,), (jnp.ones_like(t),))
        return at, along.quaternion - quaternion.derivative(at.quaternion, at.rate), along.rate - at.acceleration

    return jax.vmap(one)(times)


def check_program(program, count=1001):
    times = np.linspace(0, float(program.duration), count)
    at, quaternion_residual, rate_residual = jax.tree.map(np.asarray, evaluated(program, times))
    np.testing.assert_allclose(np.linalg.norm(at.quaternion, axis=1), 1, atol=ROUND_OFF)
    np.testing.assert_allclose(quaternion_residual, 0, atol=ROUND_OFF)
    np.testing.assert_allclose(rate_residual, 0, atol=ROUND_OFF)
    assert at.quaternion[0, 0] >= 0
    # Continuous: no step is longer than the rate allows, so none changes the sign.
    longest = np.linalg.norm(at.rate, axis=1).max() * times[1] / 2
    assert np.linalg.norm(np.diff(at.quaternion, axis=0), axis=1).max() <= 1.01 * longest + 1e-15 < 0.2
    return times, at


@jax.jit
def frames(path, frame, times):
    """The trihedra of a path, as direction cosines and as quaternions of arbitrary sign."""
    tri = jax.vmap(lambda t: trihedral(path, t, frame))(times)
    return jax.vmap(lambda tri: (tri.dcm(), tri.quaternion()))(tri)


def matrices(quaternions):
    """Direction cosines, rows the axes of the frame."""
    return np.asarray(jax.jit(jax.vmap(rotation.to_dcm))(quaternions))


@pytest.mark.parametrize("name", ["natural", "upright"])
def test_a_program_is_its_trihedral_with_one_continuous_sign(name):
    path, frame = spiral(), FRAMES[name]
    program = FrameProgram(path, frame)
    times, at = check_program(program)
    expected, raw = frames(path, frame, times)
    np.testing.assert_allclose(matrices(at.quaternion), expected, atol=ROUND_OFF)
    assert np.sum(np.abs(np.diff(np.sum(raw * at.quaternion, axis=1))) > 1) >= 3  # the raw sign does change
    # A single instant gives the same.
    one = jax.jit(lambda t: program(t).quaternion)
    for k in (130, 701, 1000):
        np.testing.assert_allclose(one(times[k]), at.quaternion[k], atol=ROUND_OFF)


def test_the_natural_frame_rotates_relative_to_the_minimizing_one_by_the_torsion():
    """On a circular helix at the rate v·χ: λ = λ_RMF∘exp(e_x vχt/2) from a common start."""
    radius, rate, climb = 5.0, 2.0, 3.0
    path = polynomial_path([radius], [0.4, rate], [0.0, climb])
    times, minimizing = check_program(FrameProgram(path, RotationMinimizing()))
    _, natural = check_program(FrameProgram(path))
    np.testing.assert_array_equal(minimizing.rate[:, 0], 0)
    np.testing.assert_array_equal(minimizing.acceleration[:, 0], 0)
    speed = math.hypot(radius * rate, climb)
    angle = rate * climb / speed * times  # vχ = φ̇ h'/v
    np.testing.assert_allclose(natural.rate[:, 0], rate * climb / speed, rtol=1e-12)
    about = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
    expected = jax.vmap(quaternion.product)(jnp.asarray(minimizing.quaternion), jnp.asarray(about))
    np.testing.assert_allclose(natural.quaternion, expected, atol=1e-12)


def winding(t):
    """A curve that is straight at its middle (κ = 0), vertical once, and of varying speed."""
    return jnp.stack([t + 0.1 * t**3, 2 * t**3, 1.5 * jnp.sin(2 * t) * t**3])


def test_the_minimizing_frame_against_an_integration():
    shift = 1.0
    program = FrameProgram(Curve(lambda t: winding(t - shift), 2.2), RotationMinimizing([0.0, 0.0, 2.0]))
    times, at = check_program(program)
    velocity = jax.jit(jax.vmap(lambda t: jnp.stack(jax.jvp(jax.jacfwd(winding), (t - shift,), (1.0,)))))

    def transport(t, n):  # n' = −(τ'·n) τ
        r1, r2 = np.asarray(velocity(np.array([t])))[0]
        return -(r2 @ n) * r1 / (r1 @ r1)

    alpha = matrices(at.quaternion)
    solution = solve_ivp(transport, (0, 2.2), alpha[0, 1], method="DOP853", rtol=3e-14, atol=1e-14, t_eval=times[::50])
    np.testing.assert_allclose(alpha[::50, 1], solution.y.T, atol=ORACLE)
    tangents = np.asarray(velocity(times))[:, 0]
    np.testing.assert_allclose(alpha[:, 0], tangents / np.linalg.norm(tangents, axis=1)[:, None], atol=ROUND_OFF)
    np.testing.assert_allclose(np.einsum("ki,kji->kj", tangents, alpha)[:, 1:], 0, atol=ROUND_OFF)
    assert alpha[0, 1, 2] > 0
    np.testing.assert_allclose(
        np.cross(alpha[0, 1], [0, 0, 1]) @ tangents[0], 0, atol=1e-1 * np.linalg.norm(tangents[0])
    )


def test_a_straight_path_does_not_rotate():
    path = polynomial_path([20.0], [0.3], [0.0, 1.0, 0.3], [0.3, 0.8, 0.1, -0.4])
    _, at = check_program(FrameProgram(path, RotationMinimizing()))
    np.testing.assert_allclose(at.quaternion, np.tile(at.quaternion[0], (1001, 1)), atol=1e-15)
    np.testing.assert_allclose([at.rate, at.acceleration], 0, atol=1e-15)


def test_a_loop_has_a_constant_binormal():
    """A planar path that is vertical twice, where the upright frame is not defined."""
    tilted = polynomial_path([4.0, 0.3], [0.0, 1.0], [0.0], [1.0, 1.0, 0.0, 0.0])
    _, at = check_program(FrameProgram(tilted, RotationMinimizing()))
    binormals = matrices(at.quaternion)[:, 2]
    np.testing.assert_allclose(binormals, np.tile([0.0, -1.0, 0.0], (1001, 1)), atol=1e-13)


def test_the_initial_attitude_can_be_chosen():
    path = spiral()
    natural = jax.jit(lambda: trihedral(path, 0.0).quaternion())()
    about = jnp.asarray([math.cos(0.35), math.sin(0.35), 0.0, 0.0])
    initial = quaternion.product(natural, about)
    by_attitude = FrameProgram(path, RotationMinimizing(-3 * initial))
    normal = rotation.to_dcm(initial)[1]
    by_normal = FrameProgram(path, RotationMinimizing(normal + 5 * path.velocity(0.0)))
    for program in (by_attitude, by_normal):
        at = program.anchors[0]
        np.testing.assert_allclose(at * np.sign(at @ initial), initial, atol=1e-13)
        assert at[0] >= 0
    # Any two differ by a constant rotation about τ.
    first, last = (p.anchors[-1] for p in (FrameProgram(path, RotationMinimizing()), by_attitude))
    np.testing.assert_allclose(np.abs(quaternion.product(quaternion.conjugate(first), last)), np.abs(about), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "mode"),
    [("natural", jax.jacrev), ("upright", jax.jacfwd), pytest.param("minimizing", jax.jacrev, marks=pytest.mark.slow)],
)
def test_gradients_with_respect_to_the_path(name, mode):
    def f(pitch):
        at = FrameProgram(spiral(pitch), FRAMES[name])(5.21)
        return jnp.concatenate([at.quaternion, at.rate, at.acceleration])

    h = 1e-5
    gradient, below, above = jax.jit(lambda x: (mode(f)(x), *jax.vmap(f)(x + jnp.asarray([-h, h]))))(1.0)
    np.testing.assert_allclose(gradient, (above - below) / (2 * h), atol=GRADIENT)


def test_the_program_is_extrapolated_outside_the_path():
    program = FrameProgram(spiral(), RotationMinimizing())
    at, quaternion_residual, rate_residual = evaluated(program, np.linspace(-0.05, 8.05, 1001))
    np.testing.assert_allclose(quaternion_residual, 0, atol=ROUND_OFF)
    np.testing.assert_allclose(rate_residual, 0, atol=ROUND_OFF)
    assert np.linalg.norm(np.diff(at.quaternion, axis=0), axis=1).max() < 0.05


@pytest.mark.parametrize(
    "frame", [Natural(), Upright([0.1, 0, 2]), RotationMinimizing(), RotationMinimizing([0, 0, 1])]
)
@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_programs_are_stored_exactly(frame, suffix, tmp_path):
    program = FrameProgram(spiral(), frame)
    program.save(tmp_path / f"program{suffix}")
    again = load(tmp_path / f"program{suffix}")
    assert jax.tree.structure(again) == jax.tree.structure(program)
    assert jax.tree.all(jax.tree.map(np.array_equal, again, program))


def test_a_program_with_a_users_function_cannot_be_stored(tmp_path):
    with pytest.raises(ValueError, match="cannot be stored"):
        FrameProgram(Curve(winding, 1.0), Upright()).save(tmp_path / "program.toml")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RotationMinimizing([1.0, 0.0]), r"quaternion \(4,\) or a normal \(3,\)"),
        (lambda: RotationMinimizing([0.0, 0.0, 0.0]), "must not be zero"),
        (lambda: RotationMinimizing([0.0, math.nan, 0.0]), "must be finite"),
        (
            lambda: FrameProgram(spiral(), RotationMinimizing([1.0, 0.0, 0.0, 0.0])),
            "the angle between the forward axis",
        ),
        (
            lambda: FrameProgram(spiral(), RotationMinimizing(spiral().velocity(0.0))),
            "must not be parallel to the path",
        ),
        (lambda: FrameProgram(spiral(), anchors=[[1.0, 0.0, 0.0, 0.0]]), "anchors must have shape"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
