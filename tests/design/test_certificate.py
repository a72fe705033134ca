"""What refined sampling finds: met, broken, undefined; and that it never calls itself a proof."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.certificate import sampled_certificate

PATH = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02], [1.0, 0.4, 0.05, -0.01], 4.5)


def test_findings_are_the_peaks_against_the_given_limits():
    time, value = qt.peak(PATH, "curvature")
    found = sampled_certificate(PATH, qt.Limits(curvature=float(value) * (1 + 1e-12), speed=1.0))
    assert found.status == {"curvature": "sampled", "speed": "broken"}
    assert found.worst["curvature"] == pytest.approx((float(time), float(value), float(value)), rel=1e-11)
    assert found.margin("speed") < 0 < found.margin("curvature")
    assert found.binding == ["curvature"]
    assert not found.met
    assert not found.holds
    assert "curvature" in str(found)
    assert "broken" in str(found)


def test_sampling_is_no_proof():
    found = sampled_certificate(PATH, qt.Limits(speed=100.0))
    assert found.met
    assert not found.holds


def test_a_peak_between_the_samples_is_found():
    """A limit a hair below a true peak that no grid instant touches."""
    curve = qt.Curve(lambda t: jnp.stack([t, jnp.zeros_like(t), -0.5 * (t - 0.7321987) ** 2]), 2.0)
    peak = 1.0  # curvature at the vertex of z = −x²/2
    found = sampled_certificate(curve, qt.Limits(curvature=peak * (1 - 1e-13)))
    assert found.status["curvature"] == "broken"
    assert found.worst["curvature"][0] == pytest.approx(0.7321987, abs=1e-7)


def test_a_maximum_on_the_border_of_a_cell_counts():
    """A cusp of curvature so narrow that Newton's method overshoots it: no value seen may be lost."""
    sharp = 2e-3
    curve = qt.Curve(lambda t: jnp.stack([(t - 0.5) ** 2 / 2, sharp * t, 0.0 * t]), 1.0)
    found = sampled_certificate(curve, qt.Limits(curvature=1.0))
    assert found.worst["curvature"][1] == pytest.approx(1 / sharp**2, rel=1e-9)


def test_the_horizontal_flip_is_undefined_and_said_where():
    start = qt.BoundaryState([20.0, 0.0, 0.0], [0.0, 8.0, 0.0])
    end = qt.BoundaryState([0.0, 40.0, 0.0], [-16.0, 0.0, 0.0])
    path = qt.SpiralHelix.from_boundary(start, end)
    found = sampled_certificate(path, qt.Limits(curvature=1.0, torsion=1.0, angular_rate=10.0))
    assert found.status == {"curvature": "sampled", "torsion": "undefined", "angular_rate": "undefined"}
    time, value, _ = found.worst["torsion"]
    assert time / float(path.duration) == pytest.approx(0.1689, abs=5e-5)
    assert math.isnan(value)
    assert not found.met


def test_a_stop_leaves_curvature_undefined_but_not_speed():
    path = qt.SpiralHelix([2.0, 0.0, 1.0], [0.3, 0.0, 1.0], [1.0], 2.0)
    found = sampled_certificate(path, qt.Limits(curvature=1.0, speed=40.0))
    assert found.status == {"curvature": "undefined", "speed": "sampled"}
    assert found.worst["curvature"][0] == pytest.approx(0.0, abs=1e-3)


def test_float32_is_refused():
    path = jax.tree.map(lambda x: x.astype(jnp.float32), PATH)
    with pytest.raises(ValueError, match="jax_enable_x64"):
        sampled_certificate(path, qt.Limits(speed=jnp.asarray(9.0, jnp.float32)))


def test_it_is_stored_exactly(tmp_path):
    from qtraj.foundation import document

    found = sampled_certificate(PATH, qt.Limits(curvature=1 / 3, torsion=1.0))
    document.save(found, tmp_path / "found.toml")
    again = qt.load(tmp_path / "found.toml")
    assert again.status == found.status
    assert again.worst == found.worst
    assert np.isfinite(again.margin("curvature"))
