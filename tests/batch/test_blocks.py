"""Blocks, traces, reductions, reused tables and several devices agree with evaluation at single instants."""

import functools
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.batch import executables, long_rows

EXACT = 1e-12
NAMES = ("position", "quaternion", "curvature", "torsion", "rate", "angular_acceleration")
TILTED = qt.Placement([5.0, -2.0, 1.0], [0.8, 0.1, -0.5, 0.3])

outside = functools.partial(qt.evaluate, extrapolate=True)
"""Evaluation at times beyond some of the paths."""


def helix(k=0.0, placement=TILTED):
    return qt.SpiralHelix(jnp.stack([20.0 + k, jnp.asarray(1.0)]), [0.2, 1.9, 0.1], [1.0, 0.4, 0.05], 4.0, placement)


@pytest.fixture(scope="module")
def stack():
    return jax.vmap(helix)(jnp.arange(3.0))


@pytest.fixture
def small_blocks(monkeypatch):
    """Blocks of 8 instants, so that few instants make several blocks and the last is incomplete."""
    for name in ("_writing", "_reduction"):
        monkeypatch.setattr(executables, name, getattr(executables, name).__wrapped__)
    monkeypatch.setattr(executables, "_samples", lambda _: 8)


def expected(path, times, name):
    """The output at each instant, from the functions of one instant."""
    return _expected(path, jnp.asarray(times))[name]


@eqx.filter_jit
def _expected(path, times):
    def one(t):
        at = qt.trihedral(path, t)
        fields = {name: getattr(at, name) for name in ("curvature", "torsion", "rate")}
        others = {"position": path.position(t), "angular_acceleration": at.acceleration}
        return fields | others | {"quaternion": at.quaternion(), "dcm": at.dcm()}

    return jax.vmap(one)(times)


def close(actual, desired):
    scale = max(1.0, float(np.abs(desired).max()))
    np.testing.assert_allclose(actual, desired, rtol=0, atol=EXACT * scale)


@pytest.mark.parametrize("count", [21, 3])  # several blocks of a row; several rows in a block
def test_the_results_do_not_depend_on_the_blocks(stack, small_blocks, count):
    times = np.linspace(0.0, 4.0, count)
    own = np.stack([times, 0.5 * times, 0.25 * times])
    shared, each = (qt.evaluate(stack, t, ("position", "quaternion", "rate")) for t in (times, own))
    names = ("quaternion", "rate")
    traced = jax.jit(lambda paths: qt.evaluate(paths, own, names))(stack)
    assert each.to_xarray()["time"].dims == ("path", "sample")
    for k in range(3):
        path = jax.tree.map(lambda x, k=k: x[k], stack)
        for name in ("position", "quaternion", "rate"):
            close(getattr(shared, name)[k], expected(path, times, name))
            close(getattr(each, name)[k], expected(path, own[k], name))
    for name in names:
        close(getattr(traced, name), getattr(each, name))


def test_one_path_in_blocks_and_under_vmap(small_blocks):
    times = np.linspace(0.0, 4.0, 21)
    table = qt.evaluate(helix(), times, NAMES)
    traced = jax.vmap(lambda k: qt.evaluate(helix(k), times, ["torsion"]).torsion)(jnp.arange(2.0))
    close(traced[0], table.torsion)
    for name in NAMES:
        close(getattr(table, name), expected(helix(), times, name))


def test_fallback_values_where_there_is_no_trihedral():
    """Straight, vertical and motionless paths: finite, not defined, and equal to the trihedral of one instant."""
    times = np.linspace(0.0, 1.0, 3)
    gradient = eqx.filter_jit(jax.grad(lambda p: sum(jnp.sum(x) for x in jax.tree.leaves(_floats(p, times)))))
    for path in (  # all have one structure, so that one executable serves them
        qt.SpiralHelix([5.0, 2.0], [0.3], [0.0, 1.0], 1.0, qt.Placement()),
        qt.SpiralHelix([5.0, 0.0], [0.3], [0.0, 2.0], 1.0, qt.Placement()),
        qt.SpiralHelix([5.0, 0.0], [0.3], [1.0, 0.0], 1.0, TILTED),
    ):
        table = qt.evaluate(path, times, ["dcm", "defined", "rate", "curvature"])
        assert not np.any(table.defined)
        close(table.dcm, expected(path, times, "dcm"))
        close(table.rate, np.zeros((3, 3)))
        assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(gradient(path)))


def _floats(path, times):
    table = qt.evaluate(path, times, ["dcm", "rate", "curvature", "angular_acceleration", "speed"])
    return table.dcm, table.rate, table.curvature, table.angular_acceleration, table.speed


@pytest.mark.slow
def test_gradients_through_blocks_agree_with_differences(small_blocks):
    times = np.linspace(0.1, 3.9, 21)

    def loss(radius, reduce=None):
        path = qt.SpiralHelix(radius, [0.2, 1.9, 0.1], [1.0, 0.4, 0.05], 4.0, TILTED)
        if reduce is not None:
            return qt.evaluate(path, times, ["rate"], reduce=reduce)["rate"][2]
        table = qt.evaluate(path, times, ["quaternion", "curvature", "angular_acceleration"], continuous=True)
        weights = jnp.cos(jnp.arange(4.0))
        total = jnp.sum(table.quaternion @ weights)
        return total + 10 * jnp.sum(table.curvature) + jnp.sum(table.angular_acceleration)

    radius, step = jnp.asarray([20.0, 1.0]), 1e-4
    for reduce in (None, "max", "integral"):
        value = jax.jit(lambda r, reduce=reduce: loss(r, reduce))
        gradient = jax.jit(jax.grad(lambda r, reduce=reduce: loss(r, reduce)))(radius)
        for k in range(2):
            d = jnp.zeros(2).at[k].set(step)
            difference = (value(radius + d) - value(radius - d)) / (2 * step)
            np.testing.assert_allclose(gradient[k], difference, rtol=1e-6, atol=1e-8)


def test_reductions_agree_with_the_samples(stack, small_blocks):
    times = np.linspace(0.0, 4.0, 21) ** 1.1
    table = outside(stack, times, ["speed", "rate"])
    for reduce, over in (("max", np.max), ("min", np.min)):
        peak = outside(stack, times, ["speed", "rate"], reduce=reduce)
        for name in ("speed", "rate"):
            samples = np.asarray(getattr(table, name))
            close(peak[name], over(samples, axis=1))
        at = np.argmax(table.speed, axis=1) if reduce == "max" else np.argmin(table.speed, axis=1)
        np.testing.assert_array_equal(peak.times["speed"], times[at])
    integral = np.trapezoid(np.asarray(table.rate), times, axis=1)
    close(outside(stack, times, ["rate"], reduce="integral")["rate"], integral)
    mean = outside(helix(), times, ["rate"], reduce="mean", components="first")
    close(mean["rate"], integral[0] / times[-1])
    assert mean.times is None
    assert outside(helix(), times[:1], ["speed"], reduce="integral")["speed"] == 0
    for count in (0, 1):
        first = outside(stack, times[count : count + 1], ["speed"], reduce="mean")["speed"]
        close(first, np.asarray(table.speed)[:, count])


@pytest.fixture
def few_segments(monkeypatch):
    """Four segments, in windows of three samples, so that few instants make a long row with a remainder."""
    monkeypatch.setattr(executables, "_reduction", executables._reduction.__wrapped__)
    monkeypatch.setattr(executables, "LONG", 20)
    monkeypatch.setattr(long_rows, "SEGMENTS", 4)
    monkeypatch.setattr(long_rows, "WINDOW", 3)


@pytest.mark.slow
@pytest.mark.parametrize("count", [24, 29])
def test_reductions_of_long_rows_agree_with_the_samples(stack, few_segments, count):
    shared = np.linspace(0.0, 4.0, count) ** 1.1
    for times in (shared, np.stack([shared, 0.5 * shared, 4.0 - shared])):
        table = outside(stack, times, ["speed", "rate"])
        speed, rate = np.asarray(table.speed), np.asarray(table.rate)
        row_times = np.broadcast_to(times, speed.shape)
        for reduce, over, which in (("max", np.max, np.argmax), ("min", np.min, np.argmin)):
            peak = outside(stack, times, ["speed", "rate"], reduce=reduce)
            close(peak["speed"], over(speed, axis=1))
            close(peak["rate"], over(rate, axis=1))
            at = which(speed, axis=1)
            np.testing.assert_array_equal(peak.times["speed"], row_times[np.arange(3), at])
            np.testing.assert_array_equal(peak.times["rate"][:, 1], row_times.min(axis=1))  # zero everywhere


def test_the_time_of_a_peak_does_not_depend_on_rounding(stack, few_segments, monkeypatch):
    """Samples that are computed twice may differ: if none equals the peak, the time is that of the largest."""
    attained = long_rows.attained
    never_equal = lambda x, peak: attained(x, peak) if peak.ndim else jnp.zeros_like(x, bool)  # noqa: E731
    monkeypatch.setattr(long_rows, "attained", never_equal)
    times = np.linspace(0.0, 4.0, 24) ** 1.1
    for reduce, which in (("max", np.argmax), ("min", np.argmin)):
        at = which(np.asarray(outside(stack, times, ["speed"]).speed), axis=1)
        np.testing.assert_array_equal(outside(stack, times, ["speed"], reduce=reduce).times["speed"], times[at])


@pytest.mark.parametrize("reduce", [None, "max", "mean"])
def test_a_path_that_is_not_finite_does_not_affect_others(stack, reduce):
    times = np.linspace(0.0, 4.0, 5)
    with_nan = eqx.tree_at(lambda path: path.duration, stack, stack.duration.at[0].set(np.nan))

    def goal(paths):
        out = qt.evaluate(paths, times, ["quaternion"], reduce=reduce)
        others = (out["quaternion"] if reduce else out.quaternion)[1:]
        return jnp.sum(others @ jnp.cos(jnp.arange(4.0))), others

    both = jax.jit(jax.value_and_grad(goal, has_aux=True))
    ((_, bad), bad_slope), ((_, good), good_slope) = both(with_nan), both(stack)
    assert np.all(np.isfinite(good))
    close(bad, good)
    close(bad_slope.radius[1:], good_slope.radius[1:])


def test_a_tied_peak_has_the_derivative_at_its_first_instant():
    """On a circle at constant speed R|φ'| all instants attain the peak; with φ2 the speed is R|φ1 + 2 φ2 t|."""
    times = np.array([0.5, 1.0, 2.0])

    def speed(angle, reduce):
        return qt.evaluate(qt.SpiralHelix([5.0], angle, [0.0], 2.0), times, ["speed"], reduce=reduce)["speed"]

    for reduce in ("max", "min"):
        slope = jax.jit(jax.grad(lambda angle, reduce=reduce: speed(angle, reduce)))(jnp.array([0.1, 2.0, 0.0]))
        close(slope, [0.0, 5.0, 2 * 5.0 * times[0]])


def test_peaks_have_derivatives_in_times_and_frame():
    """The speed increases, so its peak depends on the last instant only. Derivatives in the frame: by differences."""
    times = jnp.linspace(0.5, 3.5, 4)
    slopes_in_times = jax.jit(jax.grad(lambda t: qt.evaluate(helix(), t, ["speed"], reduce="max")["speed"]))(times)
    slope = jax.grad(lambda t: jnp.linalg.norm(helix().derivatives(t, 1)[1]))(times[-1])
    close(slopes_in_times, [0.0, 0.0, 0.0, slope])
    time_slopes = jax.jit(jax.grad(lambda t: qt.evaluate(helix(), t, ["speed"], reduce="max").times["speed"]))(times)
    close(time_slopes, [0.0, 0.0, 0.0, 1.0])

    def peak_rate(up):
        return qt.evaluate(helix(), times, ["rate"], frame=qt.Upright(up), reduce="max")["rate"][1]

    up, step = jnp.array([0.1, -0.2, 1.0]), 1e-5
    value, slopes = jax.jit(peak_rate), jax.jit(jax.grad(peak_rate))(up)
    differences = [(value(up + step * e) - value(up - step * e)) / (2 * step) for e in np.eye(3)]
    assert np.linalg.norm(differences) > 1e-3
    np.testing.assert_allclose(slopes, differences, rtol=1e-6, atol=1e-9)


def test_an_infinite_peak_is_infinite_in_a_trace_too():
    """Half a turn about y at t = 0: its Gibbs vector is infinite there."""
    path = qt.Curve(lambda t: jnp.stack([-t, t**2, 0 * t]), 1.0)
    peak = lambda: qt.evaluate(path, np.array([0.0, 0.5, 1.0]), ["gibbs"], reduce="max")  # noqa: E731
    eager, traced = peak(), jax.jit(peak)()
    assert eager["gibbs"][1] == np.inf
    assert eager.times["gibbs"][1] == 0
    np.testing.assert_array_equal(traced["gibbs"], eager["gibbs"])
    np.testing.assert_array_equal(traced.times["gibbs"], eager.times["gibbs"])


def test_reductions_have_units_and_do_not_claim_unit_norm():
    times = np.linspace(0.0, 1.0, 4)
    names = ["position", "speed", "curvature", "quaternion", "rate", "angular_acceleration", "jerk", "yaw_rate"]
    units = dict(zip(names, ["m s", "m", "m-1 s", "s", "rad", "rad s-1", "m s-2", "rad"], strict=True))
    data = qt.evaluate(helix(), times, names, reduce="integral").to_xarray()
    assert {name: data[name].attrs["units"] for name in names} == units
    assert "unit norm" not in data.attrs["quaternion_convention"]
    assert data["rate"].attrs["long_name"].startswith("integral of each component of the angular rate")


def test_a_reused_table_is_overwritten():
    times = np.linspace(0.0, 4.0, 70_000)  # few instants are evaluated in NumPy, which does not reuse arrays
    first = qt.evaluate(helix(), times, NAMES)
    pointers = [getattr(first, name).unsafe_buffer_pointer() for name in NAMES]
    expected_position = np.asarray(qt.evaluate(helix(1.0), times, NAMES).position)
    second = qt.evaluate(helix(1.0), times, NAMES, reuse=first)
    np.testing.assert_array_equal(second.position, expected_position)
    assert first.position.is_deleted()
    assert [getattr(second, name).unsafe_buffer_pointer() for name in NAMES] == pointers
    with pytest.raises(ValueError, match=r"\(70000,\)"):
        qt.evaluate(helix(), times[:20], NAMES, reuse=second)
    with pytest.raises(ValueError, match="same outputs"):
        qt.evaluate(helix(), times, ["speed"], reuse=second)


def test_float32_stays_float32():
    single = jax.tree.map(lambda x: x.astype(jnp.float32), helix())
    times = np.linspace(0.0, 4.0, 9, dtype=np.float32)
    table = qt.evaluate(single, times)
    exact = qt.evaluate(helix(), times.astype(float))
    for name in ("position", "quaternion", "rate"):
        assert getattr(table, name).dtype == jnp.float32
        np.testing.assert_allclose(getattr(table, name), getattr(exact, name), rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        ({"reduce": "median"}, "'integral' or 'mean'"),
        ({"times": np.zeros((2, 3))}, "shape (n,)"),
        ({"times": []}, "at least one instant"),
    ],
)
def test_bad_requests_are_errors(arguments, fragment):
    with pytest.raises(ValueError) as caught:
        qt.evaluate(**({"paths": helix(), "times": [0.0, 1.0]} | arguments))
    assert fragment in str(caught.value)


SHARDED = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_enable_x64", True)
import qtraj as qt
make = lambda k: qt.SpiralHelix(jnp.stack([20.0 + k, jnp.asarray(1.0)]), [0.2, 1.9], [1.0, 0.4, 0.05], 4.0)
stack, times = jax.vmap(make)(jnp.arange(4.0)), np.linspace(0.0, 4.0, 10)
both, alone = jax.local_devices(), jax.local_devices()[:1]
for paths in (stack, make(0.0), jax.vmap(make)(jnp.arange(3.0))):
    two, one = (qt.evaluate(paths, times, continuous=True, devices=d) for d in (both, alone))
    assert len(two.position.sharding.device_set) == 2
    assert len(one.position.sharding.device_set) == 1
    np.testing.assert_allclose(two.quaternion, one.quaternion, rtol=0, atol=1e-13)
    np.testing.assert_allclose(two.rate, one.rate, rtol=0, atol=1e-13)
    for reduce in ("max", "mean"):
        two, one = (qt.evaluate(paths, times, ["rate"], reduce=reduce, devices=d) for d in (both, alone))
        np.testing.assert_allclose(two["rate"], one["rate"], rtol=0, atol=1e-13)
    for reduce in ("integral", "mean"):  # part of a row may be one instant
        two, one = (qt.evaluate(paths, times[[0, 9]], ["rate"], reduce=reduce, devices=d) for d in (both, alone))
        np.testing.assert_allclose(two["rate"], one["rate"], rtol=0, atol=1e-13)
large = qt.evaluate(stack, np.linspace(0.0, 4.0, 20000), ["speed"])
assert len(large.speed.sharding.device_set) == 2
mesh = jax.sharding.Mesh(np.asarray(both), ("batch",))
rates = lambda paths: jnp.sum(qt.evaluate(paths, times, ["rate"], reduce="mean")["rate"], axis=1)
inside = lambda f: jax.shard_map(f, mesh=mesh, in_specs=jax.P("batch"), out_specs=jax.P("batch"))
slopes = jax.grad(lambda paths: jnp.sum(rates(paths)))
for f in (rates, slopes):
    for x, y in zip(jax.tree.leaves(jax.jit(inside(f))(stack)), jax.tree.leaves(jax.jit(f)(stack))):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-13)
print("agreed")
"""


def test_two_devices_agree_with_one(cached_code):
    process = subprocess.run(
        [sys.executable, "-c", SHARDED], capture_output=True, text=True, env=cached_code, check=False
    )
    assert process.stdout.strip() == "agreed", process.stderr[-2000:]


BYTES_OF_TIMES = 16
"""Memory per instant in the reverse pass: its time and one copy, but none of the forty intermediate values."""


def test_the_reverse_pass_stores_no_intermediate_values_of_all_blocks():
    def temporary(instants):
        times = jnp.linspace(0.0, 4.0, instants)

        def loss(radius):
            path = qt.SpiralHelix(radius, [0.2, 1.9], [1.0, 0.4, 0.05], 4.0)
            return jnp.sum(qt.evaluate(path, times, ["rate", "quaternion"], reduce="mean")["rate"])

        return jax.jit(jax.grad(loss)).lower(jnp.asarray([20.0, 1.0])).compile().memory_analysis().temp_size_in_bytes

    few, many = 2**16, 2**18
    assert (temporary(many) - temporary(few)) / (many - few) < BYTES_OF_TIMES
