"""Own path classes: the forms of their duration, and every function that takes a path."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt


def position(t):
    return jnp.stack([20 * jnp.sin(0.2 * t), 15 * (1 - jnp.cos(0.2 * t)) + 3.0, 0.3 * t + 0.01 * t**2])


def rows(t, order):
    functions = [position]
    for _ in range(order):
        functions.append(jax.jacfwd(functions[-1]))
    return jnp.stack([f(jnp.asarray(t, float)) for f in functions])


class AsFloat(qt.AbstractHodograph):
    duration: float

    def derivatives(self, t, order):
        return rows(t, order)


class AsStatic(qt.AbstractHodograph):
    duration: float = eqx.field(static=True, default=8.0)

    def derivatives(self, t, order):
        return rows(t, order)


class AsConstant(qt.AbstractHodograph):
    duration: ClassVar[float] = 8.0

    def derivatives(self, t, order):
        return rows(t, order)


class Plain(qt.AbstractHodograph):
    duration = 8

    def derivatives(self, t, order):
        return rows(t, order)


LIMITS = qt.Limits(curvature=1.0, speed=50.0)
TIMES = np.linspace(0.0, 8.0, 5)
CALLS = {
    "position": lambda p: p(1.0),
    "length": lambda p: p.length(),
    "state": lambda p: p.state(1.0).velocity,
    "trihedral": lambda p: qt.trihedral(p, 1.0).quaternion(),
    "certify": lambda p: qt.certify(p, LIMITS).worst["speed"],
    "varying": lambda p: qt.certify(p, qt.Limits(speed=qt.Along([0.0, 10.0], [30.0, None]))).worst["speed"],
    "peak": lambda p: qt.peak(p, "curvature")[1],
    "margins": lambda p: LIMITS.margins(p, 1.0)["speed"],
    "program": lambda p: qt.FrameProgram(p)(1.0).rate,
    "evaluate": lambda p: qt.evaluate(p, TIMES)["position"],
    "reduce": lambda p: qt.evaluate(p, TIMES, outputs=("speed",), reduce="max")["speed"],
    "dataset": lambda p: qt.evaluate(p, TIMES, outputs=("speed",)).to_xarray()["speed"].values,
    "retime": lambda p: qt.retime(p, qt.Limits(speed=10.0, acceleration=2.0)).path.duration,
    "forces": lambda p: qt.dynamics.forces(p, 1.0, 3.0, 9.81),
    "pose": lambda p: qt.PoseProgram(p, qt.FrameProgram(p))(1.0),
    "vmap": lambda p: jax.vmap(lambda t: qt.trihedral(p, t).rate)(jnp.asarray(TIMES)),
}


@pytest.mark.parametrize("call", CALLS)
def test_every_function_of_a_path_takes_an_own_path(call):
    expected = CALLS[call](qt.Curve(position, 8.0))
    result = CALLS[call](AsFloat(8.0))
    for a, b in zip(jax.tree.leaves(result), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("path", [AsStatic(), AsConstant(), Plain(), AsFloat(np.float32(8.0)), AsFloat(jnp.asarray(8))])
def test_the_forms_of_a_duration(path):
    """The batch of `evaluate` and the cells of `certify` need the shape and the dtype of a duration."""
    assert path.duration.shape == ()
    assert path.duration.dtype.kind == "f"
    assert float(path.duration) == 8.0
    assert qt.evaluate(path, TIMES, outputs=("position",)).values["position"].shape == (5, 3)
    np.testing.assert_allclose(path.length(), qt.Curve(position, 8.0).length(), rtol=1e-9)


def test_a_computed_duration():
    class Scaled(qt.AbstractHodograph):
        pace: jax.Array

        @property
        def duration(self):
            return 4.0 * self.pace

        def derivatives(self, t, order):
            return rows(t, order)

    path = Scaled(jnp.asarray(2.0))
    assert qt.certify(path, LIMITS).status["speed"] == "sampled"
    assert len(jax.vmap(Scaled)(jnp.array([1.0, 2.0]))) == 2


def test_derivatives_with_respect_to_the_duration():
    gradient = eqx.filter_grad(lambda p: p.length())(AsFloat(8.0))
    np.testing.assert_allclose(gradient.duration, jnp.linalg.norm(rows(8.0, 1)[1]), rtol=1e-6)
