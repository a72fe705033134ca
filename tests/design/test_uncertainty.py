"""Standard deviations along fitted paths: against dense matrices, sampled paths, finite differences and many fits."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BPoly, make_interp_spline
from scipy.stats import norm

import qtraj as qt
from qtraj.design.fitting.route_covariance import segment_covariances, smoothing_errors
from qtraj.design.fitting.route_window import cut
from qtraj.design.uncertainty.motion_covariance import motion_covariance
from qtraj.design.uncertainty.quantity_expansion import expand
from qtraj.design.uncertainty.uncertainty import ENTRIES
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PRINCIPAL

TIMES = np.arange(0.0, 40.0, 0.1)
CAR = qt.Vehicle(1200.0, [400.0, 900.0, 900.0], drag_area=0.6, friction=0.9, wheelbase=2.7)
NAMES = ["heading", "curvature", "horizontal_curvature", "yaw_rate", "lateral_acceleration"]
SIGMA = 0.03


def drive(t):
    s = 8 * t - 6 * np.sin(0.15 * t)
    return np.stack([s, 6 * np.sin(0.06 * s), 0.5 * np.cos(0.02 * s)], axis=1)


def recorded(seed, position=drive, times=TIMES, sigma=SIGMA):
    return qt.Track(times, position(times) + np.random.default_rng(seed).normal(0, sigma, (len(times), 3)))


@pytest.fixture(scope="module")
def fitted():
    return qt.fit_route(recorded(0), position_sigma=SIGMA)


def dense(banded):
    n = banded.shape[1]
    result = np.zeros((n, n))
    for d in range(6):
        diagonal = np.asarray(banded)[5 - d, d:]
        result += np.diag(diagonal, d) + (np.diag(diagonal, -d) if d else 0)
    return result


def dense_covariance(fitted):
    """The covariance of all states (9 n, 9 n), over knots, orders and axes, with the errors by smoothing."""
    inverse, penalty = np.linalg.inv(dense(fitted.information)), dense(fitted.penalty)
    knots = np.asarray(fitted.knots)
    states = np.stack([np.asarray(x) for x in fitted.path.sampled(knots, 2)], axis=1)
    states[:, 0] -= states[:1, 0].copy()
    shift = (-inverse @ penalty @ states.reshape(-1, 3)).reshape(-1)
    noise = float(fitted.position_sigma) ** 2 * (inverse - inverse @ penalty @ inverse)
    return np.kron(noise, np.eye(3)) + np.outer(shift, shift)


def formulas(v, a):
    """The quantities from velocities and accelerations (..., 3), written with vectors only."""
    speed, level = np.linalg.norm(v, axis=-1), np.linalg.norm(v[..., :2], axis=-1)
    cross = np.cross(v, a)
    return {
        "heading": np.arctan2(v[..., 1], v[..., 0]),
        "curvature": np.linalg.norm(cross, axis=-1) / speed**3,
        "horizontal_curvature": cross[..., 2] / level**3,
        "yaw_rate": cross[..., 2] / (speed * level),
        "lateral_acceleration": np.linalg.norm(cross, axis=-1) / speed,
    }


def test_the_sigmas_are_those_of_ten_thousand_sampled_paths(fitted):
    count, t = 10_000, np.array([0.05, 3.3, 11.0, 24.7, 39.9])
    knots = np.asarray(fitted.knots)
    states = np.stack([np.asarray(x) for x in fitted.path.sampled(knots, 2)], axis=1)
    values, axes = np.linalg.eigh(dense_covariance(fitted))
    root = axes * np.sqrt(np.maximum(values, 0.0))
    errors = (root @ np.random.default_rng(3).normal(size=(len(root), count))).reshape(-1, 3, 3, count)
    paths = BPoly.from_derivatives(knots, states[..., None] + errors)
    sampled = formulas(*(np.moveaxis(paths(t, nu=k), 1, -1) for k in (1, 2)))
    found = qt.uncertainty(fitted, t, ["position", *NAMES])
    np.testing.assert_allclose(paths(t).std(axis=-1), found.sigma["position"], rtol=0.04)
    for name in NAMES:
        linear = found.nonlinearity[name] < 0.1
        assert linear[1:-1].all()
        sigma, x = found.sigma[name][linear], sampled[name][linear]
        np.testing.assert_allclose(x.std(axis=1), sigma, rtol=0.04)
        shift = np.abs(x.mean(axis=1) - found.values[name][linear])
        assert (shift < (4 / np.sqrt(count) + found.nonlinearity[name][linear]) * sigma).all()


def test_a_magnitude_near_zero_is_reported_as_nonlinear():
    """On a straight road the curvature is the length of a random vector, so its distribution is not normal."""
    straight = qt.fit_route(recorded(1, lambda t: np.stack([9 * t, 0 * t, 0 * t], axis=1)), smoothing=0.1)
    t = np.linspace(5.0, 35.0, 31)
    found = qt.uncertainty(straight, t, ["curvature", "horizontal_curvature"])
    assert (found.nonlinearity["horizontal_curvature"] < 0.02).all()
    assert np.median(found.nonlinearity["curvature"]) > 0.2
    covariance = motion_covariance(straight, t, range(1, 3))
    rows = np.concatenate([np.asarray(x) for x in straight.path.sampled(t, 2)[1:]], axis=1)
    rng = np.random.default_rng(0)
    for k in np.flatnonzero(found.nonlinearity["curvature"] > 0.5)[:3]:
        x = rng.multivariate_normal(rows[k], covariance[k], 10_000)
        mean = formulas(x[:, :3], x[:, 3:])["curvature"].mean()
        assert mean - found.values["curvature"][k] > 0.2 * found.sigma["curvature"][k]


@pytest.mark.parametrize("name", [name for name, x in ENTRIES.items() if x.needs != PRINCIPAL])
def test_gradients_and_hessians_are_those_of_finite_differences(name):
    entry, rng = ENTRIES[name], np.random.default_rng(0)
    road = CAR.parameters(np.float64)
    r = rng.normal(size=(3 * max(entry.order, 1), 4)) + np.tile([6.0, 2.0, 0.3], max(entry.order, 1))[:, None]
    lowest = 0 if entry.position else 1
    found, h = expand(entry, r, lowest, road), 1e-5

    def at(r):
        if name == "heading":
            return np.arctan2(r[1], r[0])
        rows = [*[None] * lowest, *(tuple(r[k : k + 3]) for k in range(0, len(r), 3))]
        return entry.value(Invariants(rows, None, road))

    np.testing.assert_allclose(found.value, at(r), rtol=1e-10, atol=1e-12)
    for k, step in enumerate(h * np.eye(len(r))[:, :, None]):
        slope = (at(r + step) - at(r - step)) / (2 * h)
        scale = np.abs(found.gradient).max()
        np.testing.assert_allclose(found.gradient[k], slope, rtol=1e-6, atol=1e-7 * max(scale, 1.0))
        first, last = (expand(entry, r + x, lowest, road).gradient for x in (-step, step))
        change = (last - first) / (2 * h)
        np.testing.assert_allclose(found.hessian[k], change, rtol=1e-5, atol=1e-6 * max(np.abs(change).max(), 1.0))


def test_values_are_those_of_evaluate(fitted):
    names = [name for name in ENTRIES if name != "heading"]
    t = np.array([5.0, 11.0, 37.0])
    found, table = qt.uncertainty(fitted, t, names, CAR), qt.evaluate(fitted.path, t, names, vehicle=CAR)
    for name in names:
        np.testing.assert_allclose(found.values[name], table[name], rtol=1e-10, atol=1e-14)
        assert (found.sigma[name] > 0).all()


def test_blocks_of_the_inverse_are_those_of_dense_matrices(fitted):
    matrix, penalty = (np.asarray(x) for x in (fitted.information, fitted.penalty))
    inverse, part = np.linalg.inv(dense(matrix)), dense(penalty)
    estimate, prior = segment_covariances(matrix, penalty)
    states = np.random.default_rng(0).normal(size=(matrix.shape[1] // 3, 3, 3))
    shift = (-inverse @ part @ states.reshape(-1, 3)).reshape(states.shape)
    np.testing.assert_allclose(smoothing_errors(matrix, penalty, states), shift, rtol=1e-7, atol=1e-10)
    for k in (0, 7, len(prior) - 1):
        own = slice(3 * k, 3 * k + 6)
        np.testing.assert_allclose(prior[k], inverse[own, own], rtol=1e-7, atol=1e-12)
        expected = (inverse - inverse @ part @ inverse)[own, own]
        np.testing.assert_allclose(estimate[k], expected, rtol=1e-6, atol=1e-12)


def test_the_elimination_beyond_a_window_keeps_both_covariances(fitted):
    matrix, penalty, knots = (np.asarray(x) for x in (fitted.information, fitted.penalty, fitted.knots))
    part = cut(knots, np.zeros((len(knots), 3, 3)), matrix, penalty, knots[6], knots[20])
    for inner, whole in zip(
        segment_covariances(part.matrix, part.penalty), segment_covariances(matrix, penalty), strict=True
    ):
        np.testing.assert_allclose(inner, whole[6:20], rtol=1e-7, atol=1e-12)


def test_sigmas_of_components_are_those_of_equal_sigmas(fitted):
    many = qt.fit_route(recorded(0), position_sigma=np.full((len(TIMES), 3), SIGMA))
    t = np.array([3.0, 20.0])
    one, three = (qt.uncertainty(x, t, ["yaw_rate"]).sigma["yaw_rate"] for x in (fitted, many))
    np.testing.assert_allclose(three, one, rtol=1e-3)


def exact(position, at, last):
    """The quantities of an analytic motion, from a spline of degree 7 through many of its points."""
    t = np.linspace(0.0, last, 4001)
    spline = make_interp_spline(t, position(t), k=7)
    return formulas(*(spline(at, nu=k) for k in (1, 2)))


def bends(t):
    return np.stack([10 * t + 4 * np.sin(0.5 * t), 15 * np.sin(0.35 * t) + 2 * np.sin(1.1 * t), 0.3 * t], axis=1)


@pytest.mark.parametrize(("position", "sigma", "given"), [(drive, 0.03, True), (bends, 0.1, False)])
def test_the_errors_of_many_fitted_routes_have_these_sigmas(position, sigma, given):
    at = np.array([6.0, 13.3, 20.77, 30.0])
    right = exact(position, at, 40.0)
    scores = {name: [] for name in NAMES}
    for seed in range(16):
        fitted = qt.fit_route(recorded(seed, position, sigma=sigma), position_sigma=sigma if given else None)
        found = qt.uncertainty(fitted, at, NAMES)
        for name, z in scores.items():
            z.append((found.values[name] - right[name]) / found.sigma[name])
    for name, z in scores.items():
        assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.2, (name, np.sqrt(np.mean(np.square(z))))


def test_the_errors_of_many_fitted_turns_have_these_sigmas():
    turn = qt.SpiralHelix([30.0, 0.4, -0.02], [0.2, 0.25, 0.003], [5.0, 0.1], 8.0)
    t, at, scores = np.linspace(0, 8, 81), np.array([1.0, 4.0, 6.5]), []
    table = qt.evaluate(turn, t, ("position", "velocity"))
    p, v = np.asarray(table.position), np.asarray(table.velocity)
    right = qt.evaluate(turn, at, ("position", "yaw_rate", "curvature"))
    for seed in range(10):
        rng = np.random.default_rng(seed)
        track = qt.Track(t, p + rng.normal(0, 0.05, p.shape), v + rng.normal(0, 0.1, v.shape))
        found = qt.uncertainty(
            qt.fit(track, position_sigma=0.05, velocity_sigma=0.1), at, ["position", "yaw_rate", "curvature"]
        )
        z = [(found.values[n] - np.asarray(right[n])) / found.sigma[n] for n in ("yaw_rate", "curvature")]
        scores.append([*z, *((found.values["position"] - np.asarray(right.position)) / found.sigma["position"]).T])
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scores), axis=(0, 2))), 1.0, atol=0.25)


def test_the_covariance_of_a_turn_is_that_of_finite_differences():
    """The derivatives of the path by its parameters, along the principal directions of their covariance."""
    turn = qt.SpiralHelix([30.0, 0.4, -0.02], [0.2, 0.25, 0.003], [5.0, 0.1], 8.0)
    t = np.linspace(0, 8, 81)
    p = np.asarray(qt.evaluate(turn, t, ("position",)).position)
    fitted = qt.fit(qt.Track(t, p + np.random.default_rng(0).normal(0, 0.01, p.shape)))
    at, path, factor = np.array([1.0, 6.5]), fitted.path, np.asarray(fitted.factor)
    sizes = [2, *(len(x) for x in (path.radius, path.angle, path.height))]

    def moved(change):
        axis, radius, angle, height = np.split(change, np.cumsum(sizes)[:-1])
        origin = np.asarray(path.placement.origin) + np.append(axis, 0.0)
        placement = qt.Placement(origin, [1.0, 0.0, 0.0, 0.0])
        coefficients = (
            np.asarray(x) + y for x, y in ((path.radius, radius), (path.angle, angle), (path.height, height))
        )
        rows = qt.SpiralHelix(*coefficients, float(path.duration), placement=placement).sampled(at, 3)
        return np.concatenate([np.asarray(x) for x in rows], axis=1)

    slopes = np.stack([(moved(1e-3 * x) - moved(-1e-3 * x)) / 2e-3 for x in factor.T], axis=-1)
    expected = slopes @ np.swapaxes(slopes, 1, 2)
    scale = np.sqrt(np.einsum("nkk->nk", expected))
    found = motion_covariance(fitted, at, range(4))
    np.testing.assert_allclose(
        found / (scale[:, :, None] * scale[:, None]), expected / (scale[:, :, None] * scale[:, None]), atol=1e-4
    )
    np.testing.assert_allclose(fitted.covariance(), factor @ factor.T)


def stopping(t):
    speed = np.interp(TIMES, [0, 10, 15, 25, 31, 40], [10, 10, 0, 0, 10, 10])
    s = np.interp(t, TIMES, np.concatenate([[0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))]))
    return np.stack([60 * np.sin(s / 60), 60 - 60 * np.cos(s / 60), 0 * s], axis=1)


@pytest.fixture(scope="module")
def stopped():
    return qt.fit_route(recorded(0, stopping, sigma=0.02))


def test_at_a_stop_quantities_and_sigmas_are_undefined(stopped):
    [[start, end]] = np.asarray(stopped.stops)
    t = np.linspace(0.0, 39.9, 400)
    found = qt.uncertainty(stopped, t, ["heading", "curvature", "position", "yaw_rate"])
    rest, far = (t >= start) & (t <= end), (t < start - 6) | (t > end + 6)
    for name in found.values:
        assert np.isnan(found.sigma[name][rest]).all()
        assert np.isfinite(found.sigma[name][far]).all()
        assert (name == "position") == np.isfinite(found.values[name][rest]).all()
    beside = (t > start - 1) & (t < start - 0.05)
    assert np.isfinite(found.values["curvature"][beside]).all()
    assert np.isnan(found.sigma["curvature"][beside]).all()
    assert "unknown at" in repr(found)


def test_a_gap_is_as_uncertain_as_the_smoothing_states():
    kept = (TIMES < 15.0) | (TIMES > 20.0)
    found = qt.fit_route(recorded(0, times=TIMES[kept]), position_sigma=SIGMA)
    sigma = qt.uncertainty(found, [7.5, 17.5], ["position"]).sigma["position"]
    assert (sigma[1] > 5 * sigma[0]).all()


def test_own_quantities_are_propagated(fitted):
    climb = qt.Quantity("climb", "m/s", lambda p: p.velocity[2])
    course = qt.Quantity("course", "rad", lambda p: jnp.arctan2(p.velocity[1], p.velocity[0]))
    east = qt.Quantity("east", "m", lambda p: p.position[0])
    names = [climb, course, east, "vertical_speed", "heading", "position", "height"]
    found = qt.uncertainty(fitted, [4.0, 9.0], names)
    pairs = (("climb", "vertical_speed"), ("course", "heading"))
    for own, other in pairs:
        np.testing.assert_allclose(found.sigma[own], found.sigma[other], rtol=1e-9)
        np.testing.assert_allclose(found.nonlinearity[own], found.nonlinearity[other], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.sigma["east"], found.sigma["position"][:, 0], rtol=1e-9)
    np.testing.assert_allclose(found.sigma["height"], found.sigma["position"][:, 2], rtol=1e-9)


def test_saved_results_have_the_same_sigmas(fitted, tmp_path):
    fitted.save(tmp_path / "route.json")
    again = qt.uncertainty(qt.load(tmp_path / "route.json"), [5.0], NAMES)
    for name, sigma in qt.uncertainty(fitted, [5.0], NAMES).sigma.items():
        np.testing.assert_allclose(again.sigma[name], sigma, rtol=1e-12)


def test_tables_and_datasets_have_columns_of_sigmas(fitted):
    found = qt.uncertainty(fitted, [5.0, 6.0], ["position", "yaw_rate"])
    data, frame = found.to_xarray(), found.to_dataframe()
    assert data["yaw_rate_sigma"].attrs["units"] == "rad s-1"
    assert data["position_sigma"].dims == ("time", "world")
    np.testing.assert_array_equal(frame["position_sigma_y"], found.sigma["position"][:, 1])


def test_margins_are_those_of_the_limits(fitted):
    along = qt.Along([0.0, 150.0, 320.0], [15.0, 14.5, 15.0])
    limits = qt.Limits(curvature=0.0225, yaw_rate=(-0.3, 0.25), speed=along, friction=0.5, vehicle=CAR)
    t = np.array([0.0, 7.7, 31.0])
    found = qt.margin_uncertainty(fitted, limits, t)
    for k, at in enumerate(t):
        for name, margin in limits.margins(fitted.path, at).items():
            assert found.margin[name][k] == pytest.approx(float(margin), rel=1e-6, abs=1e-9)
    sigma = qt.uncertainty(fitted, t, ["curvature", "yaw_rate"]).sigma
    for name, of in (("curvature", "curvature"), ("yaw_rate_min", "yaw_rate"), ("yaw_rate_max", "yaw_rate")):
        np.testing.assert_allclose(found.sigma[name], sigma[of], rtol=1e-12)


def test_the_closest_margin_and_its_probability(fitted):
    found = qt.margin_uncertainty(fitted, qt.Limits(horizontal_curvature=(-0.1, 0.0222)))
    closest, score = found.closest["horizontal_curvature_max"], found.score["horizontal_curvature_max"]
    assert closest.score == score.min()
    assert closest.time == found.time[score.argmin()]
    assert closest.probability == pytest.approx(norm.cdf(closest.score))
    assert f"{closest.score:.2g} sigma" in found.result
    assert "satisfied with" in found.result
    violated = qt.margin_uncertainty(fitted, qt.Limits(curvature=0.01))
    assert violated.closest["curvature"].score < -3
    assert "violated with more than 99.99 %" in violated.result


def test_margins_without_a_standard_deviation_are_no_infinite_numbers():
    """A route without errors: its margins are more standard deviations than a text should print."""
    exact = qt.fit_route(recorded(0, sigma=0.0), position_sigma=1e-9)
    found = qt.margin_uncertainty(exact, qt.Limits(speed=20.0, curvature=0.01), [5.0])
    assert (
        "speed: satisfied with more than 99.99 % at the closest instant, 5 s, where the margin is more than 100 sigma"
        in (found.result)
    )
    assert "curvature: violated with more than 99.99 %" in found.result
    assert "less than -100 sigma" in found.result
    found = qt.MarginUncertainty(
        np.array([1.0]), {"speed": np.array([3.0])}, {"speed": np.array([0.0])}, {"speed": np.array([0.0])}
    )
    assert "inf" not in found.result + repr(found)


def test_the_text_of_margins_says_what_the_probabilities_omit(fitted):
    straight = qt.fit_route(recorded(1, lambda t: np.stack([9 * t, 0 * t, 0 * t], axis=1)), smoothing=0.1)
    for fit, rough in ((fitted, False), (straight, True)):
        found = qt.margin_uncertainty(fit, qt.Limits(curvature=0.001)).result
        assert "of first order" in found
        assert ("whose probability is rough" in found) == rough


def test_a_function_is_compiled_once():
    """New instants, another vehicle and another fit use the same executable."""
    calls = []

    def counted(p):
        calls.append(1)
        return jnp.arctan2(p.velocity[1], p.velocity[0])

    course = qt.Quantity("course", "rad", counted)
    fits = [qt.fit_route(recorded(k, times=np.arange(0.0, 10.0, 0.1)), position_sigma=SIGMA) for k in range(2)]
    qt.uncertainty(fits[0], [1.0, 2.0], [course], qt.Vehicle(900.0))
    before = len(calls)
    found = qt.uncertainty(fits[1], [3.0, 4.0], [course], qt.Vehicle(1000.0))
    assert len(calls) == before
    np.testing.assert_allclose(
        found.values["course"], qt.uncertainty(fits[1], [3.0, 4.0], ["heading"]).values["heading"]
    )


def test_margins_at_a_stop_are_unknown(stopped):
    found = qt.margin_uncertainty(stopped, qt.Limits(yaw_rate=0.3))
    assert np.isfinite(found.closest["yaw_rate"].score)
    resting = qt.margin_uncertainty(stopped, qt.Limits(yaw_rate=0.3), [20.0, 21.0])
    assert np.isnan(resting.closest["yaw_rate"].probability)
    assert "no margin is known" in resting.result


def test_violations_next_to_a_stop_are_mentioned(stopped):
    [[start, _]] = np.asarray(stopped.stops)
    found = qt.margin_uncertainty(stopped, qt.Limits(curvature=0.014), [start - 0.5])
    value = float(qt.evaluate(stopped.path, [start - 0.5], ("curvature",)).curvature[0])
    assert f"where sigma is unknown, it is violated by {value - 0.014:.3g} 1/m" in found.result
    assert "violated" not in qt.margin_uncertainty(stopped, qt.Limits(curvature=0.03), [start - 0.5]).result


def test_figures_have_bands(fitted):
    found = qt.uncertainty(fitted, np.linspace(0, 39.9, 50), ["heading", "position"])
    axes = found.plot().axes
    assert [len(a.collections) for a in axes] == [1, 3]
    vertices = axes[0].collections[0].get_paths()[0].vertices
    assert vertices[:, 1].max() == pytest.approx((found.values["heading"] + 2 * found.sigma["heading"]).max())
    margins = qt.margin_uncertainty(fitted, qt.Limits(curvature=0.1)).plot("curvature").axes
    assert [len(a.collections) for a in margins] == [1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f: qt.uncertainty(f.path, [1.0]), "fitted must be the result of qtraj.fit or qtraj.fit_route"),
        (lambda f: qt.uncertainty(f, [1.0], ["yaw"]), "unknown quantity 'yaw'; the known quantities are position"),
        (lambda f: qt.uncertainty(f, [1.0], "yaw_rate"), "must be a sequence of names"),
        (lambda f: qt.uncertainty(f, 1.0), "must have shape"),
        (lambda f: qt.uncertainty(f, [50.0]), "was given: pass track.elapsed"),
        (lambda f: qt.uncertainty(f, [1.0], ["friction"]), "needs a vehicle"),
        (lambda f: qt.margin_uncertainty(f, qt.Limits()), "the limits are empty"),
        (lambda f: qt.margin_uncertainty(f, {"curvature": 1.0}), "limits must be"),
        (
            lambda f: qt.margin_uncertainty(f, qt.Limits(lateral_acceleration=qt.BySpeed([0, 30], upper=[4, 3]))),
            "depend on the speed",
        ),
        (
            lambda f: qt.uncertainty(
                qt.Fitted(qt.SpiralHelix([20.0], [0, 0.3], [0.0], 5.0), f.residual, 0, 1, [1, 9]), [1]
            ),
            "fit again",
        ),
    ],
)
def test_wrong_arguments_are_refused(fitted, call, message):
    with pytest.raises(ValueError, match=message):
        call(fitted)


def test_the_sigmas_of_a_window_are_those_of_the_whole_fit():
    track = recorded(0)
    whole = qt.fit_route(track, knots=1.0, smoothing=0.05, position_sigma=SIGMA)
    part = qt.fit_route(track, knots=1.0, smoothing=0.05, position_sigma=SIGMA, window=(12.0, 24.0))
    times, names = np.array([0.2, 4.0, 11.9]), ["position", "yaw_rate", "speed"]
    found, expected = qt.uncertainty(part, times, names), qt.uncertainty(whole, times + 12.0, names)
    for name in names:
        np.testing.assert_allclose(found.sigma[name], expected.sigma[name], rtol=0.05)


def test_few_samples_do_not_tell_their_noise():
    track = recorded(0, times=np.arange(0.0, 6.0))
    with pytest.raises(ValueError, match="pass position_sigma to fit_route"):
        qt.uncertainty(qt.fit_route(track), [1.0])
    assert np.isfinite(qt.uncertainty(qt.fit_route(track, position_sigma=SIGMA), [1.0]).sigma["position"]).all()


def test_a_magnitude_that_is_zero_is_as_uncertain_as_its_signed_value():
    rng = np.random.default_rng(2)
    flat = drive(TIMES) * [1, 1, 0] + rng.normal(0, SIGMA, (len(TIMES), 3)) * [1, 1, 0]
    found = qt.uncertainty(
        qt.fit_route(qt.Track(TIMES, flat), position_sigma=SIGMA), [8.0], ["slope", "slope_magnitude"]
    )
    assert found.values["slope_magnitude"][0] == 0.0
    assert found.sigma["slope_magnitude"][0] == found.sigma["slope"][0] > 1e-4
