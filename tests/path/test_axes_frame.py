"""Frames of one's own: axes that are not a rotation are refused, or undefined in a trace."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

PATH = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)


@pytest.mark.parametrize(
    "axes", [2 * np.eye(3), np.diag([1.0, 1.0, -1.0]), np.ones((3, 3))], ids=["long", "left-handed", "parallel"]
)
def test_axes_that_are_not_a_rotation_are_refused(axes):
    with pytest.raises(ValueError, match="must be right-handed unit vectors at right angles"):
        qt.AxesFrame(lambda r, v, a: axes)


def test_axes_that_are_not_a_rotation_at_one_instant_are_undefined_there():
    frame = qt.AxesFrame(lambda r, v, a: jnp.eye(3) * jnp.where(r[0] < -10.0, 2.0, 1.0))
    assert bool(qt.trihedral(PATH, 1.0, frame).defined)
    there = jax.jit(lambda t: qt.trihedral(PATH, t, frame))(jnp.asarray(9.0))
    assert not bool(there.defined)
    assert np.isnan(there.tangent).all()
    assert np.isnan(there.rate).all()


def test_functions_that_cannot_be_called_or_traced_are_named():
    with pytest.raises(ValueError, match=r"arguments position, velocity and acceleration, but its signature is \(r, v"):
        qt.AxesFrame(lambda r, v: jnp.eye(3))
    with pytest.raises(ValueError, match="cannot be traced by JAX"):
        qt.FrameProgram(PATH, qt.AxesFrame(lambda r, v, a: np.eye(3) * float(np.sign(v[0]) ** 2)))(1.0)
