"""`qtraj.evaluate` agrees with the functions of one instant; labels and errors."""

import copy

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.channel import CHANNELS, Channel, outputs_with
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES, SIDES
from qtraj.path.trihedral import AbstractFrame
from qtraj.path.values import value

TIMES = np.linspace(0.0, 4.0, 7)
SHAPES = {"world": 3, "body": 3, "quaternion_component": 4}
ALL = outputs_with(None)
EXACT = 1e-13
TILTED = qt.Placement([5.0, -2.0, 1.0], [0.8, 0.1, -0.5, 0.3])


def helix(k: float = 0.0, placement: qt.Placement | None = None) -> qt.SpiralHelix:
    return qt.SpiralHelix(jnp.stack([20.0 + k, jnp.asarray(1.0)]), [0.2, 1.9], [1.0, 0.4, 0.05], 4.0, placement)


class Quintic(qt.AbstractHodograph):
    """A user-defined path in world axes with the coefficients (6, 3)."""

    coefficients: jax.Array
    duration: jax.Array

    def derivatives(self, t, order):
        def position(t):
            return jnp.stack([t**k for k in range(6)]) @ self.coefficients

        rows = [position]
        for _ in range(order):
            rows.append(jax.jacfwd(rows[-1]))
        return jnp.stack([row(t) for row in rows])

    def polynomials(self):
        x, y, z = self.coefficients.T
        return MovingPolynomials(x, y, z, jnp.zeros_like(x, shape=(1,)))


def quintic(k: float = 0.0) -> Quintic:
    rows = [[0, 0, 0], [20, 1, 2], [0.3, 2, 0.1], [0.1, -0.4, 0.2], [0.02, 0.1, -0.05], [0.003, -0.01, 0.004]]
    return Quintic(jnp.asarray(rows).at[2, 1].add(k), jnp.asarray(4.0))


class Backward(AbstractFrame):
    """A user-defined frame: the upright one, facing backwards."""

    def trihedral(self, r, duration):
        at = qt.Upright().trihedral(r, duration)
        fields = lambda at: (at.tangent, at.normal, at.rate, at.acceleration)  # noqa: E731
        return eqx.tree_at(fields, at, (-at.tangent, -at.normal, _back(at.rate), _back(at.acceleration)))


def _back(v):
    return v * jnp.asarray([-1.0, -1.0, 1.0])


def one_instant(path, t, frame):
    """All outputs from the functions of one instant."""
    at, r = qt.trihedral(path, t, frame), path.derivatives(t, 3)
    vectors = dict(zip(("position", "velocity", "acceleration", "jerk"), r, strict=True))
    frame_outputs = {"dcm": at.dcm(), "quaternion": at.quaternion(), "gibbs": at.gibbs(), "rate": at.rate}
    scalars = {"speed": at.speed, "curvature": at.curvature, "torsion": at.torsion, "defined": at.defined}
    entries = (SIDES | QUANTITIES).values()  # the quantities replace the sides with equal variables
    quantities = {x.variable: value(path, t, x.name) for x in entries if x.variable in ALL}
    return quantities | vectors | frame_outputs | scalars | {"angular_acceleration": at.acceleration}


@eqx.filter_jit
def compiled_instants(path, times, frame):
    return jax.vmap(lambda t: one_instant(path, t, frame))(times)


def single_instants(path, times, frame):
    """All outputs: in NumPy where the path consists of numbers, compiled where it calls functions of JAX."""
    if not isinstance(path, qt.SpiralHelix):
        return compiled_instants(path, jnp.asarray(times), frame)
    return jax.tree.map(lambda *x: np.stack(x), *(one_instant(path, t, frame) for t in times))


def require_equal(table, expected, k=...):
    assert expected.keys() == set(ALL)
    for name, values in expected.items():
        scale = max(1.0, np.abs(values).max())
        np.testing.assert_allclose(getattr(table, name)[k], values, rtol=0, atol=EXACT * scale, err_msg=name)


@pytest.fixture(scope="module")
def stack():
    return jax.vmap(helix)(jnp.arange(3.0))


@pytest.fixture(scope="module")
def table():
    return qt.evaluate(helix(), TIMES, ALL)


PATHS = {
    "helix": helix(),
    "tilted helix": helix(placement=TILTED),
    "user-defined polynomials": quintic(),
    "function": qt.Curve(lambda t: jnp.stack([8 * jnp.cos(t), jnp.sin(t) * 9, 0.5 * t + 0.2 * t**2]), 4.0),
}
FRAMES = {"natural": qt.Natural(), "upright": qt.Upright(), "leaning": qt.Upright([0.3, -0.2, 2.0]), "own": Backward()}


@pytest.mark.parametrize(
    ("path", "frame"),
    [
        ("helix", "natural"),
        ("tilted helix", "natural"),
        ("tilted helix", "leaning"),
        ("tilted helix", "own"),
        ("user-defined polynomials", "upright"),
        ("function", "natural"),
    ],
)
def test_all_outputs_agree_with_single_instants(path, frame):
    table = qt.evaluate(PATHS[path], TIMES, ALL, FRAMES[frame])
    require_equal(table, single_instants(PATHS[path], TIMES, FRAMES[frame]))


def test_a_stack_of_user_defined_paths():
    many = qt.evaluate(jax.vmap(quintic)(jnp.arange(3.0)), TIMES, ALL)
    for k in range(3):
        require_equal(many, single_instants(quintic(1.0 * k), TIMES, qt.Natural()), k)


def test_polynomials_are_evaluated_in_components(monkeypatch):
    """For a path with `polynomials`, no other method is called."""

    def failing(self, t, order):
        raise AssertionError("derivatives of single instants are slow")

    monkeypatch.setattr(Quintic, "derivatives", failing)
    for frame in (qt.Natural(), qt.Upright()):
        traced = jax.make_jaxpr(lambda p, frame=frame: qt.evaluate(p, TIMES, ALL, frame).position)
        traced(quintic())


def test_a_new_channel_is_one_entry(monkeypatch):
    added = Channel("drift", "m s-1", "vertical speed", (), lambda at: at.derivative(1)[2])
    monkeypatch.setitem(CHANNELS, "drift", added)
    table = qt.evaluate(helix(), TIMES, ["drift", "velocity"])
    np.testing.assert_array_equal(table.drift, table.velocity[:, 2])
    assert table.to_xarray()["drift"].attrs == {"units": "m s-1", "long_name": "vertical speed"}
    assert qt.evaluate(helix(), TIMES, ["drift"], reduce="max")["drift"] == np.max(table.drift)


def test_a_table_is_a_tree_with_attributes(table):
    assert not hasattr(table, "colour")
    with pytest.raises(AttributeError, match="'colour'"):
        _ = table.colour
    with pytest.raises(TypeError, match="'colour'"):
        qt.Table(table.time, colour=table.speed)
    double = jax.jit(lambda table: jax.tree.map(lambda x: 2 * x, table))(qt.evaluate(helix(), TIMES))
    np.testing.assert_allclose(double.position, 2 * table.position, rtol=EXACT)
    faster = eqx.tree_at(lambda table: table.speed, table, 2 * table.speed)
    np.testing.assert_array_equal(faster.speed, 2 * table.speed)
    assert copy.deepcopy(table).position.shape == (7, 3)
    assert "yaw_rate" in dir(table)
    assert "7 instants, 0 … 4 s, natural frame: position, velocity" in repr(jax.tree.map(lambda x: x, table))


def test_shapes_of_one_path_and_of_many(table, stack):
    many = qt.evaluate(stack, TIMES, ALL)
    first = qt.evaluate(stack, TIMES, ALL, components="first")
    for name in ALL:
        inner = tuple(SHAPES[axis] for axis in CHANNELS[name].axes)
        assert getattr(table, name).shape == (7, *inner)
        assert getattr(many, name).shape == (3, 7, *inner)
        assert getattr(first, name).shape == (*inner, 3, 7)
        moved = np.moveaxis(np.asarray(getattr(first, name), float), range(-2, 0), range(2))
        np.testing.assert_allclose(moved, np.asarray(getattr(many, name), float), rtol=EXACT, atol=EXACT)


def test_outputs_that_were_not_requested_are_none():
    table = qt.evaluate(helix(), TIMES)
    present = [name for name in CHANNELS if getattr(table, name) is not None]
    assert present == ["position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate"]


def test_the_quaternion_is_continuous_on_request():
    times = np.linspace(0.0, 4.0, 200)  # more than a whole turn: without `continuous` the sign must change somewhere
    canonical = qt.evaluate(helix(), times, ["quaternion"]).quaternion
    smooth = qt.evaluate(helix(), times, ["quaternion"], continuous=True).quaternion
    agreement = jnp.sum(smooth[1:] * smooth[:-1], axis=-1)
    assert float(jnp.min(agreement)) > 0.99
    assert float(jnp.min(jnp.sum(canonical[1:] * canonical[:-1], axis=-1))) < 0
    np.testing.assert_allclose(jnp.abs(jnp.sum(canonical * smooth, axis=-1)), 1.0, atol=EXACT)


def test_a_curve_without_polynomials():
    curve = qt.Curve(lambda t: jnp.stack([jnp.cos(t), jnp.sin(t), 0.5 * t]), 4.0)
    table = qt.evaluate(curve, TIMES, ["curvature", "torsion"])
    np.testing.assert_allclose(table.curvature, 0.8, rtol=1e-12)
    np.testing.assert_allclose(table.torsion, 0.4, rtol=1e-12)


@pytest.mark.parametrize("components", ["last", "first"])
def test_to_xarray_has_labels_and_all_numbers(stack, components):
    table = qt.evaluate(stack, TIMES, ALL, components=components)
    data = table.to_xarray()
    assert list(data.data_vars) == list(ALL)
    for name in ALL:
        np.testing.assert_array_equal(data[name].values, getattr(table, name))
        assert data[name].attrs["units"]
    assert data["position"].sel(world="z").dims == ("path", "time")
    assert data["time"].attrs["units"] == "s"
    assert "scalar first" in data.attrs["quaternion_convention"]


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        ({"outputs": "position"}, "sequence of names"),
        ({"outputs": ["colour"]}, "unknown output 'colour'"),
        ({"components": "middle"}, "'last' or 'first'"),
        ({"times": 3.0}, "shape (n,)"),
    ],
)
def test_bad_requests_are_errors_with_a_reason(arguments, fragment):
    with pytest.raises(ValueError) as caught:
        qt.evaluate(**({"paths": helix(), "times": TIMES} | arguments))
    assert fragment in str(caught.value)
