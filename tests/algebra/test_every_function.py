"""Every public function of rotations and their dynamics: all kinds of input, all shapes, in NumPy, jit, vmap and grad.

The functions are enumerated, so a new one is tested from its annotations, or fails here until `SIZES` has its arguments
or `OTHERS` says why it is not a function of arrays.
"""

import inspect
import typing
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.trailing_axes import TRAILING
from qtraj.foundation.types import Quat, Scalar, Vec3

MODULES = (qt.quaternion, qt.rotation, qt.dual_quaternion, qt.matrices, qt.dynamics)
KINDS = TRAILING | {Scalar: ()}
INERTIA = np.array([1.5, 2.5, 3.5])

SIZES = {
    "rotation.from_euler": (Quat, (3,)),
    "rotation.align": (Vec3, (4, 3), (4, 3)),
    "rotation.mean": (Quat, (3, 4)),
    "rotation.continuous": (Quat, (3, 4)),
    "rotation.rotation_vectors_along": (Quat, (3, 4)),
    "rotation.euler_along": (Quat, (3, 4)),
    "rotation.body_to_euler_rates": (Vec3, (3,), (3,)),
    "dynamics.acceleration": (Vec3, (3,), (3,)),
    "dynamics.torque": (Vec3, (3,), (3,)),
    "dynamics.rotational_power": (Vec3, (3,), (3,)),
}
"""Shapes of the arguments that annotations do not tell."""

CALLS = {
    "dynamics.acceleration": partial(qt.dynamics.acceleration, inertia=INERTIA),
    "dynamics.torque": lambda rate, acceleration: qt.dynamics.torque(_attitude(rate, acceleration), INERTIA),
    "dynamics.rotational_power": lambda rate, acceleration: qt.dynamics.rotational_power(
        _attitude(rate, acceleration), INERTIA
    ),
}

OTHERS = {
    **dict.fromkeys(("dynamics.forces", "dynamics.friction_demand", "dynamics.power"), "of a path at an instant"),
    **dict.fromkeys(("rotation.from_scipy", "rotation.to_scipy", "rotation.random"), "not from arrays to arrays"),
    "rotation.slerp_along": "of a table and instants",
    "dynamics.inertia_matrix": "of three forms of input, and checks them",
}

WHOLE = {(4,): [3, 1, 0, 2], (3,): [1, 0, 2], (8,): [3, 1, 0, 2, 1, 1, 4, 0], (): 2}
WHOLE |= {(3, 3): [[0, 1, 0], [0, 0, 1], [1, 0, 0]], (3, 4): [[3, 1, 0, 2], [2, 1, 1, 2], [3, 0, 0, 2]]}
WHOLE |= {(4, 3): [[1, 0, 2], [0, 3, 1], [1, 1, 1], [2, 0, 0]]}
"""Arguments of integers."""


def _attitude(rate, acceleration):
    whole = [1, 0, 0, 0]
    return qt.Attitude(jnp.asarray(whole) if isinstance(rate, jax.Array) else whole, rate, acceleration)


def found():
    """Every public function of the modules by its name."""
    for module in MODULES:
        short = module.__name__.rpartition(".")[2]
        for name in getattr(module, "__all__", None) or vars(module):
            value = getattr(module, name)
            own = hasattr(module, "__all__") or getattr(value, "__module__", "") == module.__name__
            if inspect.isfunction(value) and not name.startswith("_") and own:
                yield f"{short}.{name}", value


FUNCTIONS = dict(found())


def _called(function, arrays, fixed):
    """The sequence of axes may be the first or the last argument."""
    names = [name for name in inspect.signature(function).parameters if name not in fixed]
    return function(**fixed, **dict(zip(names, arrays, strict=False))) if fixed else function(*arrays)


def case(name):
    """A function of arrays, and the shapes of its arguments at one instant."""
    function = FUNCTIONS[name]
    parameters = inspect.signature(function).parameters.values()
    fixed = {"seq": "ZYX"} if any(p.name == "seq" for p in parameters) else {}
    call = CALLS.get(name, lambda *x: _called(function, x, fixed))
    if name in SIZES:
        return call, SIZES[name][1:]
    kinds = [p.annotation for p in parameters if p.name != "seq" and p.default is p.empty]
    kinds = [kind if kind in KINDS else (typing.get_args(kind) or (kind,))[0] for kind in kinds]
    unknown = [kind for kind in kinds if kind not in KINDS]
    assert not unknown, f"add the shapes of the arguments of {name} to SIZES"
    return call, tuple(KINDS[kind] for kind in kinds)


def drawn(sizes, shape, seed=5):
    rng = np.random.default_rng(seed)
    return [
        np.asarray(qt.rotation.to_dcm(rng.uniform(0.3, 1.2, (*shape, 4))))
        if size == (3, 3)
        else rng.uniform(0.3, 1.2, (*shape, *size))
        for size in sizes
    ]


def leaves(result):
    return [np.asarray(x, float) for x in jax.tree.leaves(result)]


def close(results, expected, atol):
    for a, b in zip(leaves(results), leaves(expected), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=0, atol=atol * (1 + np.abs(b).max(initial=0.0)))


def test_the_table_has_no_functions_that_are_gone():
    assert {*SIZES, *CALLS, *OTHERS} <= {*FUNCTIONS}
    assert len(FUNCTIONS) > 60


@pytest.mark.parametrize("name", sorted({*FUNCTIONS} - {*OTHERS}))
class TestEveryFunction:
    def test_lists_integers_and_floats_are_the_same(self, name):
        call, sizes = case(name)
        whole = [WHOLE[size] for size in sizes]
        right = call(*(np.asarray(x, float) for x in whole))
        assert all(isinstance(x, np.ndarray | np.floating) for x in jax.tree.leaves(right)), "NumPy in, NumPy out"
        for convert in (lambda x: x, np.asarray, lambda x: np.asarray(x, np.int8), lambda x: np.asarray(x, np.float32)):
            close(call(*map(convert, whole)), right, 1e-14)
        for convert, atol in ((jnp.asarray, 1e-14), (partial(jnp.asarray, dtype=jnp.float32), 1e-6)):
            results = call(*map(convert, whole))
            assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(results)), "JAX in, JAX out"
            close(results, right, atol)

    @pytest.mark.parametrize("shape", [(0,), (5,), (2, 3)])
    def test_leading_axes_are_a_batch(self, name, shape):
        call, sizes = case(name)
        arguments = drawn(sizes, shape)
        results = leaves(call(*arguments))
        for at in np.ndindex(*shape):
            close([x[at] for x in results], call(*(x[at] for x in arguments)), 1e-13)

    def test_in_jit_and_vmap_with_both_derivatives(self, name):
        call, sizes = case(name)
        arguments, directions = drawn(sizes, (5,)), drawn(sizes, (5,), seed=6)

        def total(*x):
            result = call(*x)
            parts = [jnp.ravel(y) for y in jax.tree.leaves(result)]
            return sum(jnp.sum(y * jnp.cos(jnp.arange(y.size, dtype=float))) for y in parts), result

        @jax.jit
        @jax.vmap
        def all_of(x, dx):
            _, forward, values = jax.linearize(total, *x, has_aux=True)  # one trace for both modes
            return values, forward(*dx), jax.linear_transpose(forward, *x)(1.0)

        values, forward, gradient = all_of(tuple(map(jnp.asarray, arguments)), tuple(map(jnp.asarray, directions)))
        close(values, call(*arguments), 1e-12)
        backward = sum(
            (np.asarray(g) * dx).reshape(5, -1).sum(axis=1) for g, dx in zip(gradient, directions, strict=True)
        )
        np.testing.assert_allclose(forward, backward, rtol=1e-10, atol=1e-10)
        assert np.isfinite(backward).all()
