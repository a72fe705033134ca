"""Obstacles where the direction of the body is not known, and obstacles that were made inside jit."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

ZERO = np.zeros((4, 3))
CORNER = qt.Route([0.0, 4.0, 6.0, 10.0], [[0, 0, 0], [10, 0, 0], [10, 0, 0], [10, 10, 0]], ZERO, ZERO)
"""A vehicle that stops at (10, 0), turns by 90° there, and goes on."""

LIFT = qt.Route([0.0, 4.0], [[0, 0, 0], [0, 0, 10]], [[0, 0, 2.5]] * 2, ZERO[:2])
LINE = qt.Route([0.0, 8.0], [[0, 0, 0], [40, 0, 0]], [[5, 0, 0]] * 2, ZERO[:2])
SQUARE = np.array([[19.0, -1.0], [19.0, 1.0], [21.0, 1.0], [21.0, -1.0]])
"""Clockwise corners around a point of the line."""


def status(path, obstacle, body):
    return qt.certify(path, qt.Limits(keep_out=[obstacle], body=body)).status["keep_out[0]"]


@pytest.mark.parametrize(
    "obstacle", [qt.Ball([9.0, -1.0, 0.0], 0.4), qt.Cylinder([9.0, -1.0, 0.0], [0.0, 0.0, 1.0], 0.4)]
)
def test_a_turn_in_place_beside_a_small_obstacle_is_not_broken(obstacle):
    """The offset is larger than the obstacle, and its direction is not known during the turn."""
    limits = qt.Limits(keep_out=[obstacle], body=[(3.0, 0.1)])
    assert min(qt.clearance(CORNER, np.linspace(0.0, 10.0, 401), limits)["keep_out[0]"]) > 0.4
    assert status(CORNER, obstacle, [(3.0, 0.1)]) != "broken"
    assert status(CORNER, qt.Ball([9.0, -9.0, 0.0], 0.4), [(3.0, 0.1)]) == "proved"


@pytest.mark.parametrize("offset", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_a_body_beside_a_vertical_path_may_be_in_any_direction(offset):
    """The upright frame does not exist there; a body in the obstacle was "proved" to be clear."""
    assert status(LIFT, qt.Ball([0.0, 0.0, 5.0], 2.0), [(offset, 0.5)]) == "broken"
    assert status(LIFT, qt.Ball([1.5, 0.0, 5.0], 0.2), [(offset, 0.5)]) != "proved"
    assert status(LIFT, qt.Ball([4.0, 0.0, 5.0], 2.0), [(offset, 0.5)]) == "proved"


def test_a_body_ahead_on_a_vertical_path_has_a_known_place():
    assert status(LIFT, qt.Ball([0.0, 0.0, 13.0], 1.4), [(1.0, 0.5)]) == "proved"
    assert status(LIFT, qt.Ball([0.0, 0.0, 13.0], 1.6), [(1.0, 0.5)]) == "broken"


def test_corners_in_either_sense_are_those_of_one_polygon():
    made = jax.jit(lambda scale: qt.ConvexPolygon(SQUARE * scale))(1.0)
    assert status(LINE, made, None) == "broken"
    clearance = lambda scale: qt.clearance(LINE, [4.0], qt.Limits(keep_out=[qt.ConvexPolygon(SQUARE * scale)]))  # noqa: E731
    np.testing.assert_allclose(jax.vmap(clearance)(jnp.array([1.0, 1.0]))["keep_out[0]"], [[-1.0], [-1.0]])


@pytest.mark.parametrize("radius", [-0.5, np.nan])
def test_numbers_that_were_traced_are_checked(radius):
    wrong = eqx.tree_at(lambda ball: ball.radius, qt.Ball([20.0, 0.0, 0.0], 1.0), radius)
    limits = qt.Limits(keep_out=[wrong])
    for call in (lambda: qt.certify(LINE, limits), lambda: qt.clearance(LINE, [1.0], limits)):
        with pytest.raises(ValueError, match="the radius of a ball must be positive"):
            call()


def test_a_touch_at_whole_metres_is_decided_at_once():
    """Small integers were rounded when cells were halved, so that touches took seconds."""
    certificate = qt.certify(LINE, qt.Limits(keep_out=[qt.Ball([10.0, 1.0, 0.0], 1.0)]))
    assert certificate.status["keep_out[0]"] == "proved"


@pytest.mark.parametrize("axes", [[1e-170] * 3, [1e170] * 3, [1.0, 1.0, 1e-8]])
def test_ellipsoids_that_floats_cannot_represent_are_refused(axes):
    with pytest.raises(ValueError, match="the semi-axes of an ellipsoid must be from 1e-100 m"):
        qt.Ellipsoid([0.0, 0.0, 0.0], axes)
    with pytest.raises(ValueError, match="an ellipsoid"), np.errstate(over="ignore"):
        qt.Ellipsoid([0.0, 0.0, 0.0], np.diag(np.square(axes)))


def test_the_clearance_from_a_traced_obstacle():
    clearance = lambda radius: qt.clearance(LINE, [3.0], qt.Limits(keep_out=[qt.Ball([20.0, 0.3, 0.0], radius)]))  # noqa: E731
    expected = np.hypot(5.0, 0.3) - 1.0
    np.testing.assert_allclose(jax.jit(clearance)(1.0)["keep_out[0]"], [expected])
    np.testing.assert_allclose(jax.grad(lambda radius: clearance(radius)["keep_out[0]"][0])(1.0), -1.0)
