"""Trihedra are orthonormal, their rates are derivatives, and values are finite where they do not exist."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra import matrices
from qtraj.path.frenet import Invariants
from qtraj.path.regularity import regularity
from qtraj.path.trihedral import AbstractFrame

from .conftest import as_curve

EXACT = 1e-13
FRAMES = [qt.Natural(), qt.Upright(), qt.Upright([0.3, -0.2, 2.0])]

trihedral = jax.jit(qt.trihedral)


@pytest.mark.parametrize("frame", FRAMES, ids=["natural", "upright", "leaning"])
@pytest.mark.parametrize("name", ["helix", "tilted"])
@pytest.mark.parametrize("t", [0.0, 0.9, 2.6])
def test_the_frame_is_orthonormal_and_turns_at_its_own_rate(name, t, frame, request):
    path = request.getfixturevalue(name)
    at = trihedral(path, t, frame)
    alpha = np.asarray(at.dcm())
    np.testing.assert_allclose(alpha @ alpha.T, np.eye(3), atol=EXACT)
    assert np.linalg.det(alpha) == pytest.approx(1.0, abs=EXACT)
    assert bool(at.defined)
    # α̇ = −[ω]× α in body axes, and ω̇ = ε componentwise.
    alpha_rate = jax.jvp(lambda t: qt.trihedral(path, t, frame).dcm(), (t,), (1.0,))[1]
    skew = alpha @ np.asarray(alpha_rate).T
    np.testing.assert_allclose([skew[2, 1], skew[0, 2], skew[1, 0]], at.rate, atol=1e-12)
    acceleration = jax.jvp(lambda t: qt.trihedral(path, t, frame).rate, (t,), (1.0,))[1]
    np.testing.assert_allclose(at.acceleration, acceleration, rtol=1e-10, atol=1e-12)


def test_trihedra_of_several_frames_can_be_branches_of_cond(tilted):
    branches = [lambda t, frame=frame: qt.trihedral(tilted, t, frame) for frame in FRAMES[:2]]
    for level in (False, True):
        result = jax.jit(lambda level: jax.lax.cond(level, *reversed(branches), 1.2))(level)
        np.testing.assert_allclose(result.normal, trihedral(tilted, 1.2, FRAMES[level]).normal, atol=EXACT)


def test_a_user_defined_frame_has_its_own_name(tilted):
    class Backward(AbstractFrame):
        def trihedral(self, r, duration):
            at = qt.Upright().trihedral(r, duration)
            names = lambda at: (at.tangent, at.normal)  # noqa: E731
            return eqx.tree_at(names, at, (-at.tangent, -at.normal))

    assert (qt.Natural().name, qt.Upright().name) == ("natural", "upright")
    assert qt.evaluate(tilted, [0.5, 1.0], ["rate"], frame=Backward()).frame == "backward"
    assert qt.evaluate(tilted, [0.5, 1.0], ["rate"], frame=Backward(), reduce="max").frame == "backward"
    for frame in (*FRAMES, Backward()):
        assert qt.trihedral(tilted, 0.5, frame).record().attributes["frame"] == "trihedral"


@pytest.mark.parametrize("frame", FRAMES, ids=["natural", "upright", "leaning"])
def test_a_user_defined_curve_has_the_same_trihedral(tilted, frame):
    expected, actual = trihedral(tilted, 1.2, frame), jax.jit(qt.trihedral)(as_curve(tilted), 1.2, frame)
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-12)


def test_the_natural_trihedral_by_quaternion_matrices(tilted):
    """Paper S: τ, n, b by ½(Ṙ₀ − Ṙ₀′), its square and its cube, with the errata corrected."""
    t = 1.2
    _, r1, r2 = tilted.derivatives(t, 2)
    speed = jnp.linalg.norm(r1)
    cross_norm = jnp.linalg.norm(matrices.cross_repeated(r1, r2, 1))
    at = trihedral(tilted, t)
    np.testing.assert_allclose(at.tangent, r1 / speed, atol=EXACT)
    np.testing.assert_allclose(at.normal, -matrices.cross_repeated(r1, r2, 2) / (speed * cross_norm), atol=EXACT)
    np.testing.assert_allclose(at.binormal, -matrices.cross_repeated(r1, r2, 3) / (speed**2 * cross_norm), atol=EXACT)
    # The same orientation from its quaternion: Aᵗ·ᵗAᵗ = diag(1, α).
    q = at.quaternion()
    np.testing.assert_allclose((matrices.at(q) @ matrices.tat(q))[1:, 1:], at.dcm(), atol=EXACT)


def test_a_circular_helix_has_its_textbook_curvature_and_torsion():
    a, w, c = 3.0, 0.7, 0.9
    path = qt.SpiralHelix([a], [0.0, w], [0.0, c], 5.0)
    at = trihedral(path, 2.0)
    speed2 = (a * w) ** 2 + c**2
    assert float(at.curvature) == pytest.approx(a * w**2 / speed2, rel=EXACT)
    assert float(at.torsion) == pytest.approx(w * c / speed2, rel=EXACT)
    np.testing.assert_allclose(at.acceleration, 0.0, atol=EXACT)
    np.testing.assert_allclose(at.normal, [-math.cos(2 * w), -math.sin(2 * w), 0.0], atol=EXACT)


def test_gibbs_vector_is_the_same_in_both_axes(tilted):
    at = trihedral(tilted, 0.4)
    np.testing.assert_allclose(at.dcm() @ at.gibbs(), at.gibbs(), rtol=1e-12)


def horizontal(ratio: float) -> qt.SpiralHelix:
    """The horizontal special case of paper S, r2B = ratio·r1A, with purely circumferential end velocities."""
    start = qt.BoundaryState([20.0, 0.0, 0.0], [0.0, 8.0, 0.0])
    end = qt.BoundaryState([0.0, 20.0 * ratio, 0.0], [-8.0 * ratio, 0.0, 0.0])
    return qt.SpiralHelix.from_boundary(start, end)


def binormal_sign(path: qt.SpiralHelix, part: float) -> float:
    return float(trihedral(path, part * path.duration).binormal[2])


def test_the_horizontal_case_flips_at_0_1689():
    path = horizontal(2.0)
    assert binormal_sign(path, 0.1688) == pytest.approx(-1.0)
    assert binormal_sign(path, 0.1690) == pytest.approx(1.0)

    def cross_z(part):
        r1, r2 = path.derivatives(part * path.duration, 2)[1:]
        return float(r1[0] * r2[1] - r1[1] * r2[0])

    low, high = 0.1688, 0.1690
    while high - low > 1e-16 and low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if cross_z(middle) < 0 else (low, middle)
    assert low == pytest.approx(0.1689, abs=5e-5)
    at = trihedral(path, low * path.duration)
    assert not bool(at.defined)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(at))


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(("factor", "flips"), [(0.999, False), (1.001, True)])
def test_the_flip_begins_at_the_ratio_1_plus_pi_squared_over_24(factor, flips, inverse):
    ratio = factor * (1 + math.pi**2 / 24)
    path = horizontal(1 / ratio if inverse else ratio)
    signs = {round(binormal_sign(path, part)) for part in np.linspace(0.0, 1.0, 401)}
    assert signs == ({1, -1} if flips else {1})


UNDEFINED = {
    "at rest": (qt.SpiralHelix([2.0], [0.3], [1.0], 2.0), 1.0),
    "a stop": (qt.SpiralHelix([2.0, 0.0, 1.0], [0.3], [1.0, 0.0, 0.5], 2.0), 0.0),
    "straight, radial": (qt.SpiralHelix([2.0, 1.0, 0.2], [0.3], [1.0, 0.5, 0.1], 2.0), 1.0),
    "straight, vertical": (qt.SpiralHelix([2.0], [0.3], [1.0, 0.5, 0.1], 2.0), 1.0),
    "straight, past the axis": (
        qt.Curve(lambda t: jnp.stack([jnp.asarray(3.0), 2.0 * t, 0.5 * t]) + 0.1 * jnp.sin(0.0 * t), 2.0),
        1.0,
    ),
}


@pytest.mark.parametrize("name", UNDEFINED)
def test_without_a_natural_trihedral_all_values_are_finite(name):
    path, t = UNDEFINED[name]
    at = trihedral(path, t)
    assert not bool(at.defined)
    alpha = np.asarray(at.dcm())
    np.testing.assert_allclose(alpha @ alpha.T, np.eye(3), atol=EXACT)
    np.testing.assert_array_equal(at.rate, 0.0)
    for differentiate in (jax.jacfwd, jax.jacrev):
        gradient = jax.jit(differentiate(lambda p, t: jax.tree.leaves(qt.trihedral(p, t))[:-1], argnums=1))(path, t)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
    if isinstance(path, qt.SpiralHelix):
        for mode in (jax.jacfwd, jax.jacrev):
            slopes = jax.jit(
                mode(lambda c: jnp.stack([qt.trihedral(_with_radius(path, c), t).curvature, jnp.sum(at.rate)]))
            )(path.radius)
            assert np.all(np.isfinite(slopes))


def _with_radius(path, radius):
    return qt.SpiralHelix(radius, path.angle, path.height, path.duration)


def test_the_upright_frame_exists_at_the_flip_and_on_a_straight_road():
    path = horizontal(2.0)
    for part in (0.0, 0.1689, 0.5):
        at = trihedral(path, part * path.duration, qt.Upright())
        assert bool(at.defined)
        np.testing.assert_allclose(at.binormal, [0.0, 0.0, 1.0], atol=EXACT)
    straight, t = UNDEFINED["straight, radial"]
    at = trihedral(straight, t, qt.Upright())
    assert bool(at.defined)
    np.testing.assert_allclose(at.rate, 0.0, atol=EXACT)
    np.testing.assert_allclose(at.normal, [-math.sin(0.3), math.cos(0.3), 0.0], atol=EXACT)


def test_the_upright_frame_does_not_exist_on_a_vertical_path():
    path, t = UNDEFINED["straight, vertical"]
    at = trihedral(path, t, qt.Upright())
    assert not bool(at.defined)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(at))
    with pytest.raises(ValueError, match="must not be zero"):
        qt.Upright([0.0, 0.0, 0.0])


def test_invariants_do_not_depend_on_the_basis(tilted):
    world, rotating = tilted.derivatives(1.7, 3), tilted.rotating_derivatives(1.7, 3)
    a, b = Invariants(world), Invariants(rotating)
    for name in ("S", "N", "T"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12)
    sizes = [regularity(i, tilted.duration).cross_norm for i in (a, b)]
    np.testing.assert_allclose(*sizes, rtol=1e-12)


def test_regularity_is_dimensionless():
    """The same path in millimetres and milliseconds has the same regularity."""
    path = qt.SpiralHelix([20.0, 1.0], [0.2, 0.35], [1.0, 0.4], 4.5)
    small = qt.SpiralHelix([2e4, 1.0], [0.2, 0.35e-3], [1e3, 0.4], 4.5e3)
    a = regularity(Invariants(path.derivatives(1.0, 3)), path.duration)
    b = regularity(Invariants(small.derivatives(1e3, 3)), small.duration)
    np.testing.assert_allclose([a.speed, a.cross_norm, a.level], [b.speed, b.cross_norm, b.level], rtol=1e-12)


def test_a_direct_call_is_compiled_once():
    traced = []

    def position(t):
        traced.append(t)
        return jnp.stack([2.0 * jnp.cos(t), 2.0 * jnp.sin(t), 0.1 * t])

    curve = qt.Curve(position, 3.0)
    qt.trihedral(curve, 0.3)
    count = len(traced)
    at = qt.trihedral(curve, 1.3)
    assert len(traced) == count
    np.testing.assert_allclose(
        at.tangent[:2], 2 / math.sqrt(4.01) * np.array([-math.sin(1.3), math.cos(1.3)]), rtol=1e-14
    )


def test_many_trihedra_are_computed_in_few_loops(tilted):
    """As scalars side by side they would be dozens of loops, each of which repeats the path's derivatives."""
    over_times = jax.jit(lambda path, times: jax.vmap(lambda t: qt.trihedral(path, t))(times))
    times = jnp.linspace(0.0, float(tilted.duration), 1024)
    text = over_times.lower(tilted, times).compile().as_text()
    loops = [line for line in text[text.index("ENTRY") :].splitlines() if " fusion(" in line]
    sizes = [line for line in loops if "1024" in line.split("fusion(")[0]]
    assert len(sizes) <= 20, len(sizes)  # one for the numbers, the others stack components
    many = over_times(tilted, times)
    for k in (0, 500, 1023):
        one = qt.trihedral(tilted, times[k])
        for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(one), strict=True):
            np.testing.assert_allclose(a[k], b, rtol=1e-11, atol=1e-13)
