"""Residuals between a track and a path, for known distances, velocities and directions."""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

import qtraj.foundation.document as document
from qtraj.path.curve import Curve
from qtraj.path.placement import Placement
from qtraj.path.residual import Residual, compare
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track

ROUND_OFF = 1e-9
"""[m] Accuracy of world coordinates of millions of metres in float64."""

RNG = np.random.default_rng(5)
PATH = SpiralHelix(
    [12.0, 0.5, -0.1], [0.3, 0.4], [150.0, 0.3, 0.1, -0.01], 4.0, placement=Placement([6.2e5, 4.8e6, 0.0])
)
TIMES = np.sort(RNG.uniform(0.0, 4.0, 41))
TIMES[0], TIMES[-1] = 0.0, 4.0


def track_along(path, offset=(0.0, 0.0, 0.0), velocities=True, clock=1000.0):
    states = jax.vmap(lambda t: path.derivatives(t, 1))(jnp.asarray(TIMES))
    return Track(clock + TIMES, states[:, 0] + jnp.asarray(offset)[None], states[:, 1] if velocities else None)


def test_a_track_on_the_path_has_no_residual():
    residual = compare(PATH, track_along(PATH))
    for value in (residual.horizontal_rms, residual.vertical_rms, residual.distance_rms, residual.maximum):
        assert float(value) < ROUND_OFF
    assert float(residual.velocity_rms) < ROUND_OFF
    assert float(residual.direction_rms) < ROUND_OFF
    assert int(residual.samples) == 41


def test_a_constant_offset_is_the_residual():
    residual = compare(PATH, track_along(PATH, (3.0, 4.0, -12.0)))
    np.testing.assert_allclose(residual.horizontal_rms, 5.0, atol=ROUND_OFF)
    np.testing.assert_allclose(residual.vertical_rms, 12.0, atol=ROUND_OFF)
    np.testing.assert_allclose(residual.distance_rms, 13.0, atol=ROUND_OFF)
    np.testing.assert_allclose(residual.maximum, 13.0, atol=ROUND_OFF)


def test_rms_and_maximum_of_uneven_offsets():
    track = track_along(PATH)
    offsets = RNG.normal(size=(41, 3))
    residual = compare(PATH, Track(track.times, track.positions + offsets, track.velocities + offsets))
    np.testing.assert_allclose(
        residual.horizontal_rms, np.sqrt(np.mean(np.sum(offsets[:, :2] ** 2, axis=1))), rtol=1e-8
    )
    np.testing.assert_allclose(residual.vertical_rms, np.sqrt(np.mean(offsets[:, 2] ** 2)), rtol=1e-8)
    np.testing.assert_allclose(residual.velocity_rms, np.sqrt(np.mean(np.sum(offsets**2, axis=1))), rtol=1e-8)
    np.testing.assert_allclose(residual.maximum, np.max(np.linalg.norm(offsets, axis=1)), rtol=1e-8)


@pytest.mark.parametrize("angle", [1e-9, 0.2, 3.0])
def test_velocities_turned_by_an_angle_have_that_direction_error(angle):
    """Straight east, with the recorded velocities turned about z; every other sample is at rest and ignored."""
    path = Curve(lambda t: jnp.stack([5.0 * t, 0 * t, 0 * t]), 4.0)
    at_rest = (np.arange(41) % 2)[:, None] == 1
    turned = np.where(at_rest, 0.0, 7.0 * np.array([np.cos(angle), np.sin(angle), 0.0]))
    track = Track(TIMES, np.stack([5.0 * TIMES, 0 * TIMES, 0 * TIMES], axis=1), turned)
    np.testing.assert_allclose(compare(path, track).direction_rms, angle, rtol=1e-7)


def test_radius_and_turn():
    residual = compare(PATH, track_along(PATH))
    radius = 12.0 + 0.5 * TIMES - 0.1 * TIMES**2
    np.testing.assert_allclose(residual.radius_min, radius.min(), rtol=1e-12)
    np.testing.assert_allclose(residual.radius_max, radius.max(), rtol=1e-12)
    ends = np.asarray(jax.vmap(PATH.velocity)(jnp.array([0.0, 4.0])))
    turn = np.arctan2(ends[1, 1], ends[1, 0]) - np.arctan2(ends[0, 1], ends[0, 0])
    np.testing.assert_allclose(np.angle(np.exp(1j * (float(residual.turn) - turn))), 0.0, atol=1e-9)


def test_fields_without_recorded_data_are_none():
    curve = Curve(lambda t: jnp.stack([5.0 * t, t**2, 0 * t]), 4.0)
    residual = compare(curve, track_along(curve, velocities=False))
    assert residual.velocity_rms is None
    assert residual.direction_rms is None
    assert residual.radius_min is None
    assert residual.radius_max is None


def test_a_track_longer_than_the_path_is_an_error():
    track = track_along(PATH)
    shorter = eqx.tree_at(lambda p: p.duration, PATH, jnp.asarray(3.0))
    with pytest.raises(ValueError, match=r"lasts 4 s, but the path only 3 s.*track\.window"):
        compare(shorter, track)
    assert int(compare(PATH, track.window(1000.0, 1002.0)).samples) == np.sum(TIMES <= 2.0)


def test_residuals_are_differentiable_in_the_path_even_where_they_are_zero():
    track = track_along(PATH)

    def total(radius):
        residual = compare(eqx.tree_at(lambda p: p.radius, PATH, radius), track)
        return residual.horizontal_rms + residual.maximum + residual.velocity_rms + residual.direction_rms

    assert np.all(np.isfinite(jax.grad(total)(PATH.radius)))
    other = PATH.radius + jnp.array([1.0, 0.2, 0.1])
    gradient = np.asarray(jax.grad(total)(other))
    steps = 1e-5 * np.eye(3)
    central = [float(total(other + s) - total(other - s)) / 2e-5 for s in steps]
    np.testing.assert_allclose(gradient, central, rtol=1e-5)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_residual_is_stored(tmp_path, suffix):
    residual = compare(PATH, track_along(PATH, (0.1, 0.2, 0.3)))
    document.save(residual, tmp_path / f"residual{suffix}")
    assert eqx.tree_equal(document.load(tmp_path / f"residual{suffix}"), residual)


def test_a_path_stored_with_its_residual_is_loaded_without_it(tmp_path):
    """Older versions stored the residual in the path, and the outcome of the fit in the residual."""
    PATH.save(tmp_path / "path.toml")
    document.save(compare(PATH, track_along(PATH)), tmp_path / "residual.toml")
    older = tomllib.loads((tmp_path / "residual.toml").read_text()) | {"converged": False, "message": "try a window"}
    (tmp_path / "older.toml").write_text(tomli_w.dumps(older))
    assert isinstance(document.load(tmp_path / "older.toml"), Residual)
    path = tomllib.loads((tmp_path / "path.toml").read_text()) | {"residual": older | {"type": "Residual"}}
    (tmp_path / "path.toml").write_text(tomli_w.dumps(path))
    assert eqx.tree_equal(document.load(tmp_path / "path.toml"), PATH)


def test_padding_does_not_change_the_residual():
    """The arrays are padded to sizes that many tracks share; padded samples must be ignored."""
    track = track_along(PATH, (3.0, 0.0, 0.0))
    for count in (20, 40, 41):
        part = Track(track.times[:count], track.positions[:count], track.velocities[:count])
        residual = compare(PATH, part)
        radius = 12.0 + 0.5 * TIMES[:count] - 0.1 * TIMES[:count] ** 2
        np.testing.assert_allclose([residual.distance_rms, residual.maximum], 3.0, atol=ROUND_OFF)
        np.testing.assert_allclose([residual.radius_min, residual.radius_max], [radius.min(), radius.max()], rtol=1e-12)
        assert int(residual.samples) == count
