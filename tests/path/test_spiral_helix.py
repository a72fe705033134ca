"""The boundary problems of a spiral-helix: solutions, errors, placements."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

from .conftest import states

RELATIVE = 1e-12  # relative to the size of positions and velocities


def assert_meets(path, start, end):
    for state, t in ((start, 0.0), (end, path.duration)):
        np.testing.assert_allclose(path.position(t), state.position, rtol=0, atol=RELATIVE * 40)
        np.testing.assert_allclose(path.velocity(t), state.velocity, rtol=0, atol=RELATIVE * 40)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rate", [0.4, -0.3])
@pytest.mark.parametrize("turns", [0, 2])
def test_uniform_rotation_meets_the_boundary_data(seed, rate, turns):
    start, end = states(seed, rate)
    path = qt.SpiralHelix.from_boundary(start, end, turns=turns)
    assert_meets(path, start, end)
    turn = float(path.turn)
    assert math.copysign(1, turn) == math.copysign(1, rate), "the turn has the sense of V_φ"
    assert 2 * math.pi * turns < abs(turn) < 2 * math.pi * (turns + 1)
    assert float(path.duration) == pytest.approx(turn / rate, rel=1e-14)
    assert float(path.mismatch) < 1e-14


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_a_polynomial_angle_meets_the_boundary_data_in_any_duration(turns):
    start, end = states(3, 0.4)
    end = qt.BoundaryState(end.position, end.velocity * 1.7)  # now the rates disagree
    path = qt.SpiralHelix.hermite(start, end, 5.5, turns=turns)
    assert_meets(path, start, end)
    assert float(path.duration) == 5.5
    assert -math.pi < float(path.turn) - 2 * math.pi * turns <= math.pi
    assert path.angle.shape == (4,)


def test_quintics_meet_accelerations():
    start, end = states(4, 0.4)
    start = qt.BoundaryState(start.position, start.velocity, [0.3, -1.2, 0.4])
    end = qt.BoundaryState(end.position, end.velocity, [-2.0, 0.1, 0.6])
    path = qt.SpiralHelix.hermite(start, end, 6.0)
    assert_meets(path, start, end)
    np.testing.assert_allclose(path.acceleration(0.0), start.acceleration, atol=1e-11)
    np.testing.assert_allclose(path.acceleration(6.0), end.acceleration, atol=1e-11)
    assert path.radius.shape == path.angle.shape == path.height.shape == (6,)


def test_between_turns_about_the_intersection_of_the_normals():
    start = qt.BoundaryState([623010.0, 4848000.0, 150.0], [0.0, 7.0, 0.1])
    end = qt.BoundaryState([623000.0, 4848012.0, 151.0], [-7.0, 0.0, 0.1])
    path = qt.SpiralHelix.between(start, end, 3.0)
    np.testing.assert_allclose(path.placement.origin, [623000.0, 4848000.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(path.position(3.0), end.position, atol=1e-8)
    np.testing.assert_allclose(path.velocity(3.0), end.velocity, atol=1e-9)
    assert float(path.turn) == pytest.approx(math.pi / 2)


def test_a_placement_moves_the_path_rigidly():
    start, end = states(5, 0.4)
    placement = qt.Placement([1000.0, -200.0, 30.0], [3.0, 0.2, -1.0, 0.4])

    def moved(state):
        return qt.BoundaryState(
            placement.origin + placement.to_world(state.position), placement.to_world(state.velocity)
        )

    original = qt.SpiralHelix.from_boundary(start, end)
    moved_path = qt.SpiralHelix.from_boundary(moved(start), moved(end), placement=placement)
    t = 0.3 * original.duration
    np.testing.assert_allclose(moved_path.duration, original.duration, rtol=1e-12)
    np.testing.assert_allclose(
        moved_path.position(t), placement.origin + placement.to_world(original.position(t)), rtol=0, atol=1e-9
    )
    a, b = qt.trihedral(original, t), qt.trihedral(moved_path, t)
    np.testing.assert_allclose(b.rate, a.rate, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(b.tangent, placement.to_world(a.tangent), atol=1e-12)


def test_a_half_turn_is_positive():
    """Azimuths that differ by exactly π, also where the difference is computed as −π."""
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
    end = qt.BoundaryState([-10.0, -0.0, 0.0], [0.0, -4.0, 0.0])
    assert float(qt.SpiralHelix.hermite(start, end, 5.0).turn) == pytest.approx(math.pi)
    assert float(qt.SpiralHelix.from_boundary(start, end).turn) == pytest.approx(math.pi)


@pytest.mark.parametrize("nudge", [0.0, 1e-16, -1e-16])
def test_equal_azimuths_need_a_whole_turn(nudge):
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
    end = qt.BoundaryState([12.0, 12.0 * nudge, 3.0], [0.0, 4.8, 0.0])
    with pytest.raises(ValueError, match="turns=1"):
        qt.SpiralHelix.from_boundary(start, end)
    assert float(qt.SpiralHelix.from_boundary(start, end, turns=1).turn) == pytest.approx(2 * math.pi)


@pytest.mark.parametrize("azimuth", np.linspace(-3.0, 3.0, 13))
def test_equal_azimuths_are_detected_far_from_the_origin(azimuth):
    """Rounding of world coordinates of millions of metres must not count as a tiny or a whole turn."""
    around = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    origin = np.array([623329.4, 4848831.7, 0.0])
    start = qt.BoundaryState(origin + 10 * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), 4 * around)
    end = qt.BoundaryState(origin + 13 * np.array([np.cos(azimuth), np.sin(azimuth), 0.1]), 5.2 * around)
    placement = qt.Placement(origin)
    with pytest.raises(ValueError, match="turns=1"):
        qt.tune(start, end, qt.Limits(speed=30.0), placement=placement)
    path = qt.SpiralHelix.hermite(start, end, 5.0, turns=1, placement=placement)
    assert float(path.turn) == pytest.approx(2 * math.pi, abs=1e-8)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_a_state_on_the_axis_has_finite_derivatives_inside_a_trace(mode):
    def radius(x):
        start = qt.BoundaryState(jnp.stack([x, 0.0 * x, x]), [1.0, 2.0, 0.0])
        return qt.SpiralHelix.hermite(start, END, 3.0).radius

    assert np.all(np.isfinite(jax.jit(mode(radius))(0.0)))


def test_disagreeing_rates_are_an_error_that_states_both():
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
    end = qt.BoundaryState([0.0, 20.0, 0.0], [-5.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"0\.4 rad/s at the start and 0\.25") as caught:
        qt.SpiralHelix.from_boundary(start, end)
    assert "hermite" in str(caught.value)


@pytest.mark.parametrize(("difference", "agrees"), [(0.9e-9, True), (1.2e-9, False)])
def test_rates_agree_to_1e_9(difference, agrees):
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
    end = qt.BoundaryState([0.0, 20.0, 0.0], [-8.0 * (1 + difference), 0.0, 0.0])
    if agrees:
        qt.SpiralHelix.from_boundary(start, end)
    else:
        with pytest.raises(ValueError, match="disagree"):
            qt.SpiralHelix.from_boundary(start, end)


AXIS = qt.BoundaryState([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
START = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
END = qt.BoundaryState([0.0, 10.0, 0.0], [-4.0, 0.0, 0.0])
RADIAL = qt.BoundaryState([10.0, 0.0, 0.0], [4.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.SpiralHelix.from_boundary(AXIS, END), "start lies on the axis"),
        (lambda: qt.SpiralHelix.hermite(START, AXIS, 3.0), "end lies on the axis"),
        (lambda: qt.SpiralHelix.from_boundary(RADIAL, qt.BoundaryState([0, 10.0, 0], [0, 4.0, 0])), "V_phi is 0"),
        (lambda: qt.SpiralHelix.from_boundary(START, END, turns=-1), "must be 0 or more, but -1 was given"),
        (lambda: qt.SpiralHelix.hermite(START, END, [3.0, 4.0]), "one number"),
        (lambda: qt.SpiralHelix.from_boundary(dataclasses.replace(START, acceleration=[0.0, 0, 0]), END), "accel"),
        (lambda: qt.SpiralHelix.hermite(dataclasses.replace(START, acceleration=[0.0, 0, 0]), END, 1.0), "both ends"),
        (lambda: qt.SpiralHelix.hermite(START, END, 0.0), "positive"),
        (lambda: qt.SpiralHelix.between(START, START, 3.0), "parallel"),
        (lambda: qt.SpiralHelix.between(START, qt.BoundaryState([0, 1.0, 0], [0, 0, 1.0]), 3.0), "parallel"),
    ],
)
def test_bad_problems_are_errors_with_a_reason(make, fragment):
    with pytest.raises(ValueError) as caught:
        make()
    assert fragment in str(caught.value)


def test_inside_a_trace_the_mismatch_shows_disagreeing_rates():
    @jax.jit
    def mismatch(speed):
        end = qt.BoundaryState([0.0, 20.0, 0.0], jnp.stack([-speed, 0.0 * speed, 0.0 * speed]))
        return qt.SpiralHelix.from_boundary(START, end).mismatch

    assert float(mismatch(8.0)) == 0
    assert float(mismatch(4.0)) == pytest.approx(0.5)
    assert float(mismatch(-8.0)) == pytest.approx(2.0)


def test_inside_a_trace_an_unsolvable_problem_has_an_infinite_mismatch():
    @jax.jit
    def path(velocity):
        return qt.SpiralHelix.from_boundary(qt.BoundaryState([10.0, 0.0, 0.0], velocity), END)

    assert np.isinf(path(jnp.asarray([4.0, 0.0, 0.0])).mismatch)


def test_ten_thousand_boundary_problems_compile_once():
    compiled = 0

    @jax.jit
    def solve(positions, velocities, rates):
        nonlocal compiled
        compiled += 1

        def one(p, v, rate):
            start = qt.BoundaryState(p[0], jnp.stack([v[0], rate * p[0, 0], v[1]]))
            end = qt.BoundaryState(p[1], jnp.stack([-rate * p[1, 1], v[2], v[3]]))
            path = qt.SpiralHelix.from_boundary(start, end)
            return path, jnp.max(jnp.abs(path.position(path.duration) - end.position))

        return jax.vmap(one)(positions, velocities, rates)

    rng = np.random.default_rng(7)
    for _ in range(2):
        p = np.zeros((10_000, 2, 3))
        p[:, 0, 0], p[:, 1, 1], p[:, :, 2] = *rng.uniform(10, 50, (2, 10_000)), rng.uniform(-3, 3, (10_000, 2))
        paths, errors = solve(p, rng.uniform(-2, 2, (10_000, 4)), rng.uniform(0.1, 1.0, 10_000))
        assert paths.radius.shape == (10_000, 4)
        assert float(jnp.max(errors)) < 1e-11
        np.testing.assert_allclose(jax.vmap(lambda path: path.turn)(paths), math.pi / 2, rtol=1e-12)
    assert compiled == 1


def test_a_path_of_float32_has_no_float64():
    """Its values have the widest dtype of its numbers."""
    start, end = (jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), x) for x in states())
    for path in (
        qt.SpiralHelix.hermite(start, end, jnp.float32(3.0)),
        qt.SpiralHelix(*(jnp.asarray(x, jnp.float32) for x in ([10.0, 1.0], [0.0, 1.0], [0.0, 0.5])), jnp.float32(3)),
    ):
        assert {x.dtype for x in jax.tree.leaves(path)} == {np.dtype(np.float32)}
        assert qt.evaluate(path, jnp.linspace(0.0, 3.0, 5, dtype=jnp.float32)).position.dtype == np.float32
