"""The classes of obstacles: arguments, distances, storage, and clearances with derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

HELIX = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
EVERY = [
    qt.Ball([[0.0, 25.0, 1.0], [0.1, 0.0, 0.0]], 2.0),
    qt.Cylinder([20.0, -6.0, 0.0], [0.0, 0.1, 1.0], 2.0),
    qt.Ellipsoid([0.0, 30.0, 1.0], [[3.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 2.0]]),
    qt.HalfSpace([0.0, 0.2, 1.0], -3.0),
    qt.ConvexPolygon([[-5.0, -5.0], [-5.0, 5.0], [5.0, 5.0], [5.0, -5.0]]),
]


def test_limits_with_obstacles_are_stored_exactly(tmp_path):
    limits = qt.Limits(speed=3.0, keep_out=EVERY, body=[(2.0, 1.0), ((1.0, 0.5, 0.2), 0.4)])
    from qtraj.foundation.document import save

    for suffix in (".toml", ".json"):
        save(limits, tmp_path / f"limits{suffix}")
        loaded = qt.load(tmp_path / f"limits{suffix}")
        assert jax.tree.all(jax.tree.map(lambda x, y: np.array_equal(x, y), limits, loaded))
        assert repr(loaded) == repr(limits)


def test_margins_and_clearances_agree():
    limits = qt.Limits(curvature=0.1, keep_out=EVERY, body=[(2.0, 1.0), ((1.0, 0.5, 0.2), 0.4)])
    times = np.array([0.0, 4.0, 10.0])
    found = qt.clearance(HELIX, times, limits)
    assert list(found) == [f"keep_out[{k}]" for k in range(5)]
    for k, t in enumerate(times):
        margins = limits.margins(HELIX, t)
        assert margins["curvature"] > 0
        for name, values in found.items():
            assert margins[name] == pytest.approx(values[k], abs=1e-12)


@pytest.mark.parametrize("k", range(5))
def test_clearances_are_differentiable(k):
    limits = qt.Limits(keep_out=[EVERY[k]], body=[((1.0, 0.5, 0.2), 0.4)])

    def clearance(t):
        return qt.clearance(HELIX, t, limits)["keep_out[0]"]

    value, slope = jax.jit(jax.value_and_grad(clearance))(2.0)
    assert value == pytest.approx(clearance(2.0), abs=1e-12)
    assert slope == pytest.approx((clearance(2.0 + 1e-6) - clearance(2.0 - 1e-6)) / 2e-6, abs=1e-7)


def test_many_instants_in_jax():
    limits = qt.Limits(keep_out=EVERY[:2], body=[(1.0, 0.4)])
    times = np.array([2.0, 5.0])
    found = jax.jit(lambda t: qt.clearance(HELIX, t, limits))(times)
    for name, values in qt.clearance(HELIX, times, limits).items():
        np.testing.assert_allclose(found[name], values, atol=1e-12)


def test_closed_forms_of_distances():
    """An ellipsoid of revolution on its axes, and a polygon at a wall, at a corner and inside."""
    ball = qt.Ellipsoid([1.0, 0.0, 0.0], [2.0, 2.0, 2.0])
    points = np.array([[5.0, 0.0, 0.0], [1.0, 3.0, 4.0], [1.0, 0.0, 1.0]])
    np.testing.assert_allclose(ball.distance(points, np.zeros(3)), [2.0, 3.0, -1.0], atol=1e-13)
    square = EVERY[4]
    points = np.array([[7.0, 1.0, 9.0], [8.0, 9.0, 0.0], [1.0, -2.0, 0.0]])
    np.testing.assert_allclose(square.distance(points, np.zeros(3)), [2.0, 5.0, -3.0], atol=1e-13)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: qt.Ball([0.0, 0.0], 1.0), "centre of a ball must have shape"),
        (lambda: qt.Ball([0.0, 0.0, 0.0], 0.0), "radius of a ball must be positive"),
        (lambda: qt.Ball([0.0, np.nan, 0.0], 1.0), "must be finite"),
        (lambda: qt.Cylinder([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 1.0), "axis of a cylinder must not be zero"),
        (lambda: qt.HalfSpace([0.0, 0.0, 0.0], 1.0), "normal of a half space must not be zero"),
        (lambda: qt.Ellipsoid([0.0, 0.0, 0.0], [[1.0, 2.0, 0], [2.0, 1.0, 0], [0, 0, 1.0]]), "positive definite"),
        (lambda: qt.Ellipsoid([0.0, 0.0, 0.0], [1.0, -1.0, 1.0]), "semi-axes of an ellipsoid must be positive"),
        (lambda: qt.ConvexPolygon([[0.0, 0.0], [1.0, 0.0]]), "at least|m ≥ 3"),
        (lambda: qt.ConvexPolygon([[0, 0], [4, 0], [1, 1], [0, 4]]), "convex polygon"),
        (lambda: qt.ConvexPolygon([[0, 3], [-2, -3], [3, 1], [-3, 1], [2, -3]]), "convex polygon"),
        (lambda: qt.Limits(keep_out=[EVERY[0]], body=[(0.0, -1.0)]), "radii of a body must not be negative"),
        (lambda: qt.Limits(keep_out=[EVERY[0]], body=[]), "at least one ball"),
        (lambda: qt.Limits(keep_out=[EVERY[0]], body=[([1.0, 2.0], 1.0)]), "offset of a ball"),
        (lambda: qt.Limits(body=[(0.0, 1.0)]), "body was given without obstacles"),
        (lambda: qt.clearance(HELIX, 0.0, qt.Limits(speed=1.0)), "no obstacles"),
        (lambda: qt.clearance(HELIX, 11.0, qt.Limits(keep_out=EVERY)), "times must be within"),
    ],
)
def test_bad_values_are_errors(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("given", [EVERY[0], 3.0, [EVERY[0], "ball"]])
def test_other_obstacles_are_type_errors(given):
    with pytest.raises(TypeError, match="keep_out"):
        qt.Limits(keep_out=given)
    with pytest.raises(TypeError, match="body"):
        qt.Limits(keep_out=[EVERY[0]], body=[1.0])


def test_batches_and_tracers_of_helices_have_the_certificates_of_single_paths():
    limits = qt.Limits(speed=9.0, keep_out=[EVERY[1], EVERY[0]], body=[(-1.0, 0.4), (1.0, 0.4)])
    heights = np.array([0.4, 0.5, 0.6])
    each = [qt.certify(qt.SpiralHelix([20.0], [0.0, 0.3], [h], 10.0), limits) for h in heights]
    make = lambda h: qt.SpiralHelix(jnp.array([20.0]), jnp.array([0.0, 0.3]), jnp.stack([h]), jnp.asarray(10.0))  # noqa: E731
    together = qt.certify(jax.vmap(make)(jnp.asarray(heights)), limits)
    traced = jax.jit(lambda h: (lambda c: (c.codes, c.values))(qt.certify(make(h), limits)))
    for k, one in enumerate(each):
        assert together[k].status == one.status
        np.testing.assert_allclose(together.values[k], one.values, rtol=1e-12)
        codes, values = traced(heights[k])
        np.testing.assert_array_equal(codes, one.codes)
        np.testing.assert_allclose(values, one.values, rtol=1e-12)


def test_the_clearance_in_a_certificate_is_differentiable():
    limits = qt.Limits(keep_out=[qt.Cylinder([30.0, 1.0, 0.0], [0.0, 0.0, 1.0], 2.0)])

    def clearance(radius):
        path = qt.SpiralHelix(jnp.stack([radius]), jnp.array([0.0, 0.3]), jnp.array([0.5]), jnp.asarray(10.0))
        return qt.certify(path, limits).values[0]

    # The nearest point of the circle is in the direction of the axis of the cylinder.
    assert clearance(20.0) == pytest.approx(np.hypot(30.0, 1.0) - 22.0, rel=1e-9)
    assert jax.grad(clearance)(20.0) == pytest.approx(-1.0, rel=1e-6)


def test_certify_needs_concrete_obstacles_and_one_route():
    x = np.linspace(0.0, 60.0, 3)
    route = qt.Route(x / 5.0, *(np.stack([v, 0 * x, 0 * x], axis=1) for v in (x, 0 * x + 5.0, 0 * x)))
    with pytest.raises(ValueError, match="concrete values"):
        jax.jit(lambda r: qt.certify(HELIX, qt.Limits(keep_out=[qt.Ball([9.0, 0.0, 0.0], r)])).values)(0.5)
    with pytest.raises(ValueError, match="concrete values"):
        jax.grad(lambda h: qt.certify(jax.tree.map(lambda v: v * h, route), qt.Limits(keep_out=[EVERY[1]])).code)(1.0)
