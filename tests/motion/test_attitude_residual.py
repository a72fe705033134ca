"""Recorded attitudes compared with a program: SciPy's mean as mounting, and known residuals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.motion.attitude_residual import mounting_text

HELIX = qt.SpiralHelix([20.0, 0.5], [0.1, 0.4], [1.0, 0.3], 4.0)
TIMES = np.linspace(0.0, 4.0, 60)
MOUNTING = Rotation.from_euler("ZYX", [0.8, -0.1, 0.05])


@pytest.fixture(scope="module")
def program():
    return qt.FrameProgram(HELIX, qt.Upright())


@pytest.fixture(scope="module")
def reference(program):
    return Rotation.from_quat(np.asarray(jax.vmap(program)(TIMES).quaternion), scalar_first=True)


def recorded(rotations, seed=18):
    """A track with these attitudes, of either sign and any length."""
    rng = np.random.default_rng(seed)
    lengths = rng.choice([-1.0, 1.0], len(TIMES)) * rng.uniform(0.1, 10.0, len(TIMES))
    positions = np.array(jax.vmap(HELIX.position)(TIMES))
    return qt.Track(100.0 + TIMES, positions, None, lengths[:, None] * rotations.as_quat(scalar_first=True))


def test_a_constant_mounting_is_estimated_without_a_residual(program, reference):
    result = qt.compare_attitude(program, recorded(reference * MOUNTING))
    same = abs(result.mounting @ MOUNTING.as_quat(scalar_first=True))
    assert float(same) == pytest.approx(1.0, abs=1e-14)
    assert float(result.maximum) < 1e-12
    assert int(result.samples) == len(TIMES)


@pytest.mark.parametrize(
    ("angles", "words"),
    [
        ((92.1, -3, 0), "yaw 92.1°, pitch -3.0° (nose up), roll 0.0°; beyond that 0.00° RMS"),
        ((0, 1e-9, -1e-9), "yaw 0.0°, pitch 0.0°, roll 0.0°; beyond that 0.00° RMS"),
    ],
)
def test_the_text_of_a_mounting(program, reference, angles, words):
    turned = reference * Rotation.from_euler("ZYX", angles, degrees=True)
    assert mounting_text(qt.compare_attitude(program, recorded(turned))) == f"mounted at {words}"


def test_noise_is_averaged_as_by_scipy(program, reference):
    vectors = np.random.default_rng(5).normal(size=(len(TIMES), 3)) * [0.02, 0.05, 0.1]
    attitudes = reference * MOUNTING * Rotation.from_rotvec(vectors)
    result = qt.compare_attitude(program, recorded(attitudes))
    mean = (reference.inv() * attitudes).mean()
    assert float(abs(result.mounting @ mean.as_quat(scalar_first=True))) == pytest.approx(1.0, abs=1e-13)
    residual = (mean.inv() * reference.inv() * attitudes).as_rotvec()
    np.testing.assert_allclose(result.axis_rms, np.sqrt(np.mean(residual**2, axis=0)), rtol=1e-9)
    angles = np.linalg.norm(residual, axis=1)
    assert float(result.rms) == pytest.approx(np.sqrt(np.mean(angles**2)))
    assert (float(result.maximum), float(result.time)) == pytest.approx((angles.max(), TIMES[angles.argmax()]))
    fixed = qt.compare_attitude(program, recorded(attitudes), 3.0 * MOUNTING.as_quat(scalar_first=True))
    np.testing.assert_allclose(fixed.axis_rms, np.sqrt(np.mean(vectors**2, axis=0)), rtol=1e-9)


def test_the_residual_has_derivatives_in_the_path(program, reference):
    attitudes = reference * MOUNTING * Rotation.from_rotvec(np.random.default_rng(7).normal(0, 0.05, (len(TIMES), 3)))
    track = recorded(attitudes)

    def rms(climb):
        path = qt.SpiralHelix(HELIX.radius, HELIX.angle, jnp.stack([jnp.ones(()), climb]), HELIX.duration)
        return qt.compare_attitude(qt.FrameProgram(path, qt.Upright()), track).rms

    slope = float(rms(0.9 + 1e-5) - rms(0.9 - 1e-5)) / 2e-5
    assert float(jax.grad(rms)(0.9)) == pytest.approx(slope, rel=1e-5)
    assert float(jax.jacfwd(rms)(0.9)) == pytest.approx(slope, rel=1e-5)


def test_a_fit_reports_recorded_attitudes_and_keeps_them(reference, tmp_path):
    fitted = qt.fit(recorded(reference * MOUNTING))
    assert float(abs(fitted.attitude.mounting @ MOUNTING.as_quat(scalar_first=True))) == pytest.approx(1.0, abs=1e-6)
    assert float(fitted.attitude.maximum) < 1e-3
    dataset = fitted.to_xarray()
    assert float(dataset["attitude_rms"]) == float(fitted.attitude.rms)
    fitted.save(tmp_path / "fitted.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "fitted.toml").attitude.mounting, fitted.attitude.mounting)
    plain = qt.fit(qt.Track(TIMES, np.array(jax.vmap(HELIX.position)(TIMES))))
    assert plain.attitude is None
    assert "attitude_rms" not in plain.to_xarray()


def test_samples_at_a_stop_are_left_out(program):
    """At residual the upright frame is not defined, so a wrong recording there does not count."""
    ends = [qt.BoundaryState([20.0, 0, 0], [0.0, 0, 0]), qt.BoundaryState([0, 20.0, 0], [-8.0, 1.0, 0])]
    starting = qt.FrameProgram(qt.SpiralHelix.hermite(*ends, 4.0), qt.Upright())
    quaternions = np.array(jax.vmap(starting)(TIMES).quaternion)
    positions = np.array(jax.vmap(starting.path.position)(TIMES))
    quaternions[0] = [0.5, 0.5, 0.5, 0.5]
    result = qt.compare_attitude(starting, qt.Track(TIMES, positions, None, quaternions))
    assert (int(result.samples), float(result.maximum) < 1e-7) == (len(TIMES) - 1, True)
    standing = qt.FrameProgram(qt.Curve(lambda t: jnp.zeros(3) + 0 * t, 4.0), qt.Upright())
    with pytest.raises(ValueError, match=r"not defined at any sample.*track\.window"):
        qt.compare_attitude(standing, qt.Track(TIMES, positions, None, quaternions))


def test_unsuitable_tracks_and_mountings_are_refused(program, reference):
    track = recorded(reference)
    with pytest.raises(ValueError, match=r"has no attitudes to compare.*AttitudeAngles"):
        qt.compare_attitude(program, qt.Track(TIMES, track.positions))
    with pytest.raises(ValueError, match="the track lasts 4 s, but the program lasts only 3 s"):
        qt.compare_attitude(qt.FrameProgram(qt.SpiralHelix([20.0], [0.0, 0.4], [0.0], 3.0)), track)
    with pytest.raises(ValueError, match="must be a non-zero quaternion"):
        qt.compare_attitude(program, track, [0.0, 0.0, 0.0, 0.0])
    assert "RMS" in repr(qt.compare_attitude(program, track))
