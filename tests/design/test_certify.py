"""Certificates: proofs agree with 50-digit arithmetic, and sampling is never reported as a proof."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from benchmarks.turns import element, exact_square, random_turns

import qtraj as qt
from qtraj.algebra import polynomial
from qtraj.design.proof.certify import BLOCK_SIZE
from qtraj.foundation import document
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import invariants_at

PATH = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02], [1.0, 0.4, 0.05, -0.01], 4.5)
POLYNOMIAL = ("curvature", "torsion", "lateral_acceleration", "longitudinal_acceleration")


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_proofs_agree_with_50_digit_arithmetic(motion):
    """Limits slightly above and below the peaks, on random paths."""
    count = 16
    paths = random_turns(count, motion)
    certify = jax.jit(jax.vmap(qt.certify))  # compiled once, for the peaks as for the limits about them
    loose = jax.vmap(lambda x: qt.Limits(**dict.fromkeys(POLYNOMIAL, x)))(jnp.full(count, 1e3, float))
    certificate = certify(paths, loose)
    peaks = dict(zip(certificate.names, certificate.values.T, strict=True))
    margin = jnp.asarray(np.resize([1e-3, 1e-8, -1e-8, -1e-3], count))
    limits = jax.vmap(lambda peaks, margin: qt.Limits(**{n: p * (1 + margin) for n, p in peaks.items()}))(peaks, margin)
    certificate = certify(paths, limits)
    for j in range(count):
        path, statuses = element(paths, j), certificate[j].status
        for k, name in enumerate(certificate.names):
            status = statuses[name]
            assert status == ("proved" if margin[j] > 0 else "broken"), (name, j)
            with mpmath.workdps(50):
                bound = mpmath.mpf(float(certificate.limits[j, k])) ** 2
                worst = exact_square(path, name, float(certificate.times[j, k]))
                assert (worst > bound) == (status == "broken")
                assert float(mpmath.sqrt(worst)) == pytest.approx(float(certificate.values[j, k]), rel=1e-9)
                times = [float(path.duration) * i / 4 for i in range(5)]
                if status == "proved":
                    assert all(exact_square(path, name, t) <= bound for t in times)


@pytest.mark.slow
def test_the_rate_of_the_natural_frame_and_its_acceleration_are_proved_for_uniform_cubics():
    path = element(random_turns(3, "uniform"), 1)
    times = path.duration * jnp.linspace(0.0, 1.0, 4001)
    frames = jax.jit(jax.vmap(lambda t: qt.trihedral(path, t)))(times)
    rate, acceleration = (float(jnp.max(jnp.linalg.norm(x, axis=-1))) for x in (frames.rate, frames.acceleration))
    for factor, status in ((1 + 1e-4, "proved"), (1 - 1e-4, "broken")):
        certificate = qt.certify(
            path, qt.Limits(angular_rate=factor * rate, angular_acceleration=factor * acceleration)
        )
        assert certificate.status == {"angular_rate": status, "angular_acceleration": status}
        assert certificate.worst["angular_rate"][1] == pytest.approx(rate, rel=1e-5)


def test_limits_of_the_highest_degrees_are_proved_and_refuted():
    """Accelerations of both frames, whose inequalities are of degree 200 and more in hermite motion."""
    path = element(random_turns(2, "hermite"), 0)
    names = ["angular_acceleration", "yaw_acceleration", "jerk", "yaw_rate"]
    peaks = {name: float(qt.peak(path, name)[1]) for name in names}
    above = qt.certify(path, qt.Limits(**{name: 1.001 * value for name, value in peaks.items()}))
    below = qt.certify(path, qt.Limits(**{name: 0.999 * value for name, value in peaks.items()}))
    assert set(above.status.values()) == {"proved"}, str(above)
    assert set(below.status.values()) == {"broken"}, str(below)
    for name, value in peaks.items():
        assert above.worst[name][1] == pytest.approx(value, rel=1e-9), name


def test_a_curve_is_sampled():
    """A limit slightly below a peak between the grid instants is broken; one above it is satisfied."""
    curve = qt.Curve(lambda t: jnp.stack([t, jnp.zeros_like(t), -0.5 * (t - 0.7321987) ** 2]), 2.0)
    peak = 1.0  # curvature at the vertex of z = −x²/2
    certificate = qt.certify(curve, qt.Limits(curvature=peak * (1 - 1e-13)))
    assert certificate.status["curvature"] == "broken"
    assert certificate.worst["curvature"][0] == pytest.approx(0.7321987, abs=1e-7)
    assert qt.certify(curve, qt.Limits(curvature=peak * (1 + 1e-9))).status["curvature"] == "sampled"


def test_a_maximum_on_the_border_of_a_cell_counts():
    """A cusp of curvature so narrow that Newton's method overshoots it: the node's own value must count."""
    width = 2e-3
    curve = qt.Curve(lambda t: jnp.stack([(t - 0.5) ** 2 / 2, width * t, 0.0 * t]), 1.0)
    certificate = qt.certify(curve, qt.Limits(curvature=1.0))
    assert certificate.worst["curvature"][1] == pytest.approx(1 / width**2, rel=1e-9)


def test_a_peak_between_samples_is_refuted():
    """ρ̇ = 3(t − at)² and ω small: the path nearly stops for a moment, and its curvature has a narrow peak there."""
    at = 55.5 / 128
    path = qt.SpiralHelix([5.0, 3 * at**2, -3 * at, 1.0], [0.0, 1e-6, 0.0], np.zeros(4), 1.0)
    coarse = jnp.linspace(0.0, 1.0, 129)
    limit = 10 * float(jnp.max(jax.vmap(lambda t: qt.Limits(curvature=1.0).values(path, t)["curvature"])(coarse)))
    certificate = qt.certify(path, qt.Limits(curvature=limit))
    assert certificate.status["curvature"] == "broken"
    time, value, _ = certificate.worst["curvature"]
    assert time == pytest.approx(at, abs=5e-3)
    assert value > limit


@pytest.mark.parametrize(("end", "status"), [([0.0, 40.0, 0.0], "undefined"), ([0.0, 20.0, 0.0], "proved")])
def test_the_horizontal_flip_is_undefined_and_located(end, status):
    """Paper S's horizontal special case: the trihedral jumps where the ratio of the radii is beyond 1 + π²/24."""
    start = qt.BoundaryState([20.0, 0.0, 0.0], [0.0, 8.0, 0.0])
    path = qt.SpiralHelix.from_boundary(start, qt.BoundaryState(end, [-0.4 * end[1], 0.0, 0.0]))
    certificate = qt.certify(path, qt.Limits(curvature=1.0, torsion=1.0, angular_rate=10.0))
    assert certificate.status == {"curvature": "proved", "torsion": status, "angular_rate": status}
    time, value, _ = certificate.worst["torsion"]
    if status == "undefined":
        assert time / float(path.duration) == pytest.approx(0.1689, abs=5e-5)
        assert math.isnan(value)
        assert "undefined at" in certificate.describe("torsion")
        assert not certificate.met


def test_a_stop_leaves_curvature_undefined_but_not_speed():
    path = qt.SpiralHelix([2.0, 0.0, 1.0, 0.0], [0.3, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], 2.0)
    certificate = qt.certify(path, qt.Limits(curvature=1.0, speed=40.0))
    assert certificate.status == {"curvature": "undefined", "speed": "proved"}
    assert certificate.worst["curvature"][0] == pytest.approx(0.0, abs=1e-3)


def test_the_slope_is_proved_about_a_vertical_axis_and_sampled_about_another():
    turned = qt.Placement([5.0, 1.0, 0.0], [math.cos(0.3), 0.0, 0.0, math.sin(0.3)])
    tilted = qt.Placement([0.0, 0.0, 0.0], [math.cos(0.1), math.sin(0.1), 0.0, 0.0])
    coefficients = (PATH.radius, PATH.angle, PATH.height, PATH.duration)
    status = [
        qt.certify(qt.SpiralHelix(*coefficients, placement), qt.Limits(slope=5.0)).status["slope"]
        for placement in (None, turned, tilted)
    ]
    assert status == ["proved", "proved", "sampled"]


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e8])
def test_proofs_do_not_depend_on_the_size_of_a_path(scale):
    """Lengths and the duration are scaled together: speeds are unchanged, and curvatures scale inversely."""
    powers = scale ** -np.arange(4.0)
    path = qt.SpiralHelix(
        scale * PATH.radius * powers, PATH.angle * powers[:3], scale * PATH.height * powers, scale * PATH.duration
    )
    _, peak = qt.peak(PATH, "curvature")
    limits = qt.Limits(curvature=peak / scale * (1 + 1e-8), speed=100.0)
    assert qt.certify(path, limits).holds
    assert qt.certify(path, qt.Limits(curvature=peak / scale * (1 - 1e-8))).status["curvature"] == "broken"


def test_the_initial_height_and_azimuth_do_not_matter():
    """A path 6400 km above the origin is proved like one at height 0."""
    _, peak = qt.peak(PATH, "slope")
    limits = qt.Limits(slope=peak * (1 + 1e-8), curvature=1.0)
    high = qt.SpiralHelix(PATH.radius, [1e4, *PATH.angle[1:]], [6.4e6, *PATH.height[1:]], PATH.duration)
    assert qt.certify(high, limits).holds


def test_a_path_that_overflows_is_not_proved():
    """Only the last cells overflow; the curvature violates its limit earlier."""
    path = qt.SpiralHelix([1.0, 0.0, -0.3], [0.0, 1e49, 0.0, 0.0, 1e50], [0.0, 0.0], 1.0)
    certificate = qt.certify(path, qt.Limits(curvature=1.4))
    assert certificate.worst["curvature"][1] > 1.4
    assert not certificate.met


@pytest.mark.parametrize("loose", [1.01, 10.0, 1000.0])
def test_the_largest_value_does_not_depend_on_the_limit(loose):
    _, peak = qt.peak(PATH, "curvature")
    _, value, _ = qt.certify(PATH, qt.Limits(curvature=loose * peak)).worst["curvature"]
    assert value == pytest.approx(float(peak), rel=1e-9)


def test_a_violated_limit_is_not_active():
    names, times, values, limits = ["speed", "slope"], [0.0, 1.0], [1.0, 1.0], [1.0, 1.0]
    certificate = qt.Certificate(names, [0, 3], times, values, limits)
    assert certificate.status == {"speed": "proved", "slope": "undecided"}
    assert certificate.active == ["speed"]
    assert certificate.unmet == ["slope"]


def test_quintics_are_proved():
    start = qt.BoundaryState([20.0, 0.0, 0.0], [0.5, 8.0, 0.3], [0.2, 0.1, 0.0])
    end = qt.BoundaryState([0.0, 25.0, 1.0], [-8.0, 0.3, 0.2], [0.0, -0.3, 0.0])
    certificate = qt.certify(qt.SpiralHelix.hermite(start, end, 4.5), qt.Limits(speed=30.0, torsion=50.0))
    assert certificate.holds, str(certificate)


def test_values_are_differentiable():
    """The peak's gradient by the envelope theorem against a central difference."""

    def peak(stretch):
        path = qt.SpiralHelix(PATH.radius * stretch, PATH.angle, PATH.height, PATH.duration)
        return qt.certify(path, qt.Limits(curvature=1.0)).values[0]

    h = 1e-5
    difference = (peak(1 + h) - peak(1 - h)) / (2 * h)
    _, push = jax.linearize(peak, 1.0)  # traced once for both modes
    (reverse,) = jax.linear_transpose(push, 1.0)(jnp.ones(()))
    assert float(push(1.0)) == pytest.approx(float(difference), rel=1e-6)
    assert float(reverse) == pytest.approx(float(difference), rel=1e-6)


def test_a_batch_equals_its_elements():
    paths = random_turns(5, "uniform")
    limits = qt.Limits(curvature=0.08, speed=9.0)
    batch = qt.certify(paths, limits)
    assert batch.codes.shape == (5, 2)
    for k in range(5):
        single = qt.certify(element(paths, k), limits)
        assert single.status == batch[k].status
        assert single.worst["curvature"] == pytest.approx(batch[k].worst["curvature"], rel=1e-9)
    assert batch.holds.tolist() == [batch[k].holds for k in range(5)]
    assert "5 paths" in str(batch)
    grid = jax.tree.map(lambda x: jnp.stack([x, x]), paths)
    assert jnp.array_equal(qt.certify(grid, qt.Limits(speed=9.0)).codes[1], batch.codes[:, 1:])
    with pytest.raises(ValueError, match=r"must have the leading shape \(5,\)"):
        qt.certify(eqx.tree_at(lambda p: p.radius, paths, PATH.radius), limits)


@pytest.mark.slow
def test_blocks_on_all_cores_agree_with_one_trace():
    paths = random_turns(BLOCK_SIZE + 6, "uniform")
    limits = jax.vmap(lambda v: qt.Limits(speed=v))(jnp.linspace(5.0, 12.0, BLOCK_SIZE + 6))
    shared, traced = qt.certify(paths, limits), jax.jit(qt.certify)(paths, limits)
    assert jnp.array_equal(shared.codes, traced.codes)
    assert len(set(shared.codes[:, 0].tolist())) > 1
    np.testing.assert_allclose(shared.values, traced.values, rtol=1e-12)
    none = jax.tree.map(lambda x: x[:0], (paths, limits))
    assert qt.certify(*none).codes.shape == (0, 1)


def test_texts_raise_inside_a_trace():
    with pytest.raises(ValueError, match="created inside jit, grad or vmap"):
        jax.jit(lambda path: qt.certify(path, qt.Limits(speed=1.0)).status)(PATH)


def test_findings_compare_the_peaks_with_the_limits():
    time, value = qt.peak(PATH, "curvature")
    certificate = qt.certify(PATH, qt.Limits(curvature=float(value) * (1 + 1e-10), speed=1.0))
    assert certificate.status == {"curvature": "proved", "speed": "broken"}
    assert certificate.worst["curvature"] == pytest.approx((float(time), float(value), float(value)), rel=1e-7)
    assert certificate.margin("speed") < 0 < certificate.margin("curvature")
    assert certificate.active == ["curvature"]
    assert not certificate.met
    assert not certificate.holds
    assert "curvature" in str(certificate)
    assert "broken" in str(certificate)


def test_a_path_in_float32_is_proved_as_the_rational_numbers_that_it_contains():
    path = jax.tree.map(lambda x: x.astype(jnp.float32), PATH)
    same = jax.tree.map(lambda x: x.astype(jnp.float64), path)
    peak = qt.certify(same, qt.Limits(curvature=1.0)).worst["curvature"][1]
    for factor, status in ((1 + 1e-12, "proved"), (1 - 1e-12, "broken")):
        limits = qt.Limits(curvature=peak * factor)
        assert qt.certify(path, limits).status == qt.certify(same, limits).status == {"curvature": status}


def test_a_certificate_is_stored_exactly(tmp_path):
    certificate = qt.certify(PATH, qt.Limits(curvature=1 / 3, speed=1.0))
    document.save(certificate, tmp_path / "found.toml")
    loaded = qt.load(tmp_path / "found.toml")
    assert loaded.status == certificate.status
    assert loaded.worst == certificate.worst
    assert np.isfinite(loaded.margin("curvature"))


class Cubic(qt.AbstractHodograph):
    """A user-defined path: three cubics in world axes."""

    coefficients: jax.Array
    duration: jax.Array = eqx.field(converter=jnp.asarray)

    def derivatives(self, t, order):
        factorials = jnp.asarray([float(math.factorial(k)) for k in range(order + 1)])
        return jnp.stack([polynomial.taylor(c, t, order) * factorials for c in self.coefficients], axis=1)

    def polynomials(self):
        x, y, z = self.coefficients
        return MovingPolynomials(x, y, z, jnp.zeros(1))


def test_a_user_defined_polynomial_path_is_proved():
    coefficients = jnp.asarray([[0.0, 5.0, 0.4, -0.1], [1.0, 0.3, 0.8, 0.0], [0.0, 0.2, 0.0, 0.05]])
    path = Cubic(coefficients, 3.0)
    curve = qt.Curve(lambda t: coefficients @ jnp.stack([jnp.ones_like(t), t, t * t, t * t * t]), 3.0)
    names = ["curvature", "torsion", "slope", "angular_rate", "jerk", "yaw_rate"]
    peaks = dict(zip(names, (float(qt.peak(curve, name)[1]) for name in names), strict=True))
    above = qt.certify(path, qt.Limits(**{name: 1.0001 * value for name, value in peaks.items()}))
    below = qt.certify(path, qt.Limits(**{name: 0.9999 * value for name, value in peaks.items()}))
    assert set(above.status.values()) == {"proved"}, str(above)
    assert set(below.status.values()) == {"broken"}, str(below)


@pytest.mark.parametrize("name", [name for name, entry in QUANTITIES.items() if not entry.needs])
def test_the_proved_ratio_equals_the_evaluated_square(name):
    entry, path = QUANTITIES[name], element(random_turns(2, "hermite"), 0)
    certificate = invariants_at(path, 0.3 * path.duration, max(entry.order, 1))
    ratio = entry.numerator(certificate) / (1.0 if entry.denominator is None else entry.denominator(certificate))
    square = entry.tangent(np.sqrt(entry.squared(certificate))) ** 2
    assert float(square) == pytest.approx(float(ratio), rel=1e-12)
