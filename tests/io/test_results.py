"""Every result converts to labelled data, a line of text and HTML, for one problem and for a batch."""

import re
from html.parser import HTMLParser

import jax
import jax.numpy as jnp
import numpy as np
import pandas
import pyarrow.parquet as pq
import pytest
import xarray

import qtraj as qt
from qtraj.foundation import record
from qtraj.foundation.result import AbstractResult, counts_text, extent
from qtraj.io import netcdf
from qtraj.io.flat import flatten, unflatten
from qtraj.path.residual import compare

EXACTLY = {} if tuple(map(int, pandas.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
"""The option with which pandas reads every digit; since 3.1 it is the default."""
SUFFIXES = [".nc", ".zarr", ".parquet", ".csv"]
INSTANTS = np.array([0.0, 0.1, 1 / 3])
BATCH = 3
REACHED = qt.ResultCode.successful
HOSTILE = "<script>alert(1)</script>&\"'"
UNITS_IN_MEANING = ("objective", "bound", "bound_along", "worst_value", "segment_worst_value", "peak", "margin")
UNITS_IN_MEANING += ("smallest_singular_value", "joints", "joint_rates", "joint_accelerations")
"""Numbers whose units depend on the case, such as angles and lengths of joints; the meaning contains them."""
LONGEST = 240
"""Maximum number of characters of a summary."""


def repeated(result, batch=BATCH):
    """A batch of copies of one result."""
    return jax.tree.map(lambda x: jnp.stack([x] * batch), result)


def uneven(result, batch=BATCH):
    """A batch of slightly different copies of one result."""
    shift = np.arange(batch) / 3
    return jax.tree.map(lambda x: jnp.asarray((np.asarray(x) + shift.reshape(-1, *[1] * x.ndim)), x.dtype), result)


def single():
    """One result of every type, built from its parts: these tests check labels, not solvers."""
    ends = [qt.BoundaryState([10.0, 0, 0], [1.0, 4.0, 1 / 3]), qt.BoundaryState([0, 10.0, 1], [-4.0, 0, 0.5])]
    path = qt.SpiralHelix([10.0, 0.1], [0.2, 0.4], [1.0, 1 / 3], 2.0, qt.Placement([1 / 7, 2, 3]))
    certificate = qt.Certificate(["curvature", "slope"], [0, 4], [0.1, 0.2], [1 / 3, np.nan], [0.5, 0.7])
    track = qt.Track(np.arange(5.0) / 3 + 7, np.arange(15.0).reshape(5, 3) / 3, attitudes=np.ones((5, 4)) / 3)
    n = len(INSTANTS)
    quaternion, rate = np.arange(4.0 * n).reshape(n, 4) / 3, np.ones((n, 4)) / 7
    vectors = jnp.eye(3)
    return {
        "path": path,
        "route": qt.Route(INSTANTS, *(np.arange(9.0).reshape(3, 3) / k for k in (3, 5, 7))),
        "fitted": qt.Fitted(path, compare(path, track), qt.ResultCode.held_by_bounds, 9, [5.0, 20.0]),
        "fitted route": qt.FittedRoute(
            qt.Route([0.0, 4 / 3], *np.zeros((3, 2, 3))),
            compare(path, track),
            1 / 3,
            outliers=[2, 3],
            stops=[[0.0, 1 / 3]],
        ),
        "certificate": certificate,
        "route certificate": qt.RouteCertificate(
            certificate,
            qt.Certificate(certificate.names, *np.arange(12.0).reshape(3, 2, 2) % 5, [0.5, 0.7]),
            [0.0, 1.5],
        ),
        "tuned route": qt.TunedRoute(
            qt.Route(INSTANTS, *(np.arange(9.0).reshape(3, 3) / k for k in (3, 5, 7))),
            qt.RouteCertificate(
                certificate,
                qt.Certificate(certificate.names, *np.arange(12.0).reshape(3, 2, 2) % 5, [0.5, 0.7]),
                INSTANTS[:2],
            ),
            1 / 3,
            np.ones((2, 2)) / 7,
            [True, False],
            np.ones((3, 3)) / 3,
            1 / 7,
        ),
        "retimed": qt.Retimed(
            qt.RetimedPath(path, qt.Timing([[1.0, 0.1, 0, 0], [1.1, 0, 0, 1 / 3]], [0.0, 1.0, 2.0])),
            2.0,
            certificate,
            np.arange(4.0).reshape(2, 2) / 3,
            [1 / 3, 2.0],
            0,
            7,
        ),
        "speed profile": qt.SpeedProfile(
            ("speed", "jerk"),
            *(INSTANTS * k for k in range(1, 7)),
            np.ones((2, n)) / 3,
            np.ones((2, n)) / 5,
            np.arange(3.0),
            np.ones((2, 2)) / 7,
            np.array([-1, 1]),
            *np.arange(6.0).reshape(3, 2) / 3,
            np.zeros((1, 2)),
            np.zeros(1),
        ),
        "state": qt.BoundaryState([10.0, 0, 1 / 7], [1.0, 4.0, 1 / 3], [0.0, -1.6, 1 / 7]),
        "tuned": qt.Tuned(path, *ends, 1 / 3, certificate, 0, 7, "try less", starts_tried=8),
        "table": qt.Table(jnp.asarray(INSTANTS), quaternion=jnp.asarray(quaternion), speed=jnp.asarray(INSTANTS)),
        "uncertainty": qt.Uncertainty(
            jnp.asarray(INSTANTS), *({"speed": INSTANTS / k, "position": rate[:, :3] / k} for k in (3, 5, 7))
        ),
        "margin uncertainty": qt.MarginUncertainty(
            jnp.asarray(INSTANTS), *({"curvature": (1 + INSTANTS) / k} for k in (3, 5, 7))
        ),
        "trihedral": qt.Trihedral(*vectors, *vectors[0] / 3, *vectors[:2] / 7, jnp.asarray(True)),
        "attitude": qt.Attitude(jnp.ones(4) / 2, jnp.ones(3) / 3, jnp.ones(3) / 7),
        "closed": qt.Solution(INSTANTS, quaternion, rate, 0, rate / 3, quaternion / 5, INSTANTS / 3),
        "body": qt.BodyMotion(INSTANTS, rate[:, 1:] / 5, rate[:, 1:] / 9, rate / 3, rate / 11, quaternion / 13),
        "arm": qt.ArmMotion(
            INSTANTS,
            *[quaternion] * 3,
            rate[:, 1:],
            quaternion,
            rate,
            quaternion / 5,
            *[INSTANTS / 3] * 3,
            0,
            *[INSTANTS] * 2,
        ),
        "pose": qt.PoseMotion(
            INSTANTS,
            *[rate[:, 1:]] * 3,
            quaternion,
            rate,
            rate / 3,
            np.concatenate([quaternion, rate], axis=1),
            INSTANTS,
            INSTANTS / 3,
            0,
        ),
        "open": qt.Solution(INSTANTS, quaternion, rate, qt.ResultCode.max_steps_reached, axes="inertial"),
        "closed form": qt.control.ClosedMotion(INSTANTS, quaternion / 5, quaternion, INSTANTS / 3),
        "friction": qt.dynamics.FrictionDemand(jnp.asarray(1 / 3), jnp.asarray(0.5)),
        "propagation": qt.Propagation(*map(jnp.asarray, (INSTANTS, quaternion, 1e-13, 7, REACHED))),
        "track": track,
        "residual": compare(path, track),
        **verdicts(path),
    }


def verdicts(path):
    """What the commands find out: of a slew, of a closed loop, of a changed path."""
    one, half = [1.0, 0, 0, 0], [1.0, 1 / 3, 0, 0]
    program = qt.EulerTurn(one, half, qt.Quintic(duration=2.0))
    law, still = qt.AccelerationLaw(2.0, 1.0), jnp.zeros(4)
    solution = qt.simulate(program, law, half, still, INSTANTS)
    history = qt.loop_history(program, law, half, still, solution)
    return {
        "slew history": qt.slew_history(program, INSTANTS, 2.0),
        "slew verdict": qt.judge_slew(program, {"max_rate": 0.1}, inertia=2.0, max_torque=0.5),
        "loop history": history,
        "loop verdict": qt.judge_loop(history, law),
        "path change": qt.compare_paths(path, path),
    }


def many():
    one = single()
    tuned = repeated(one["tuned"])
    different = {name: uneven(one[name]) for name in ("path", "state", "attitude", "closed", "closed form")}
    positions = jnp.arange(18.0).reshape(2, 3, 3) / 7  # paths, instants, components
    each = jnp.asarray(np.stack([INSTANTS, INSTANTS / 2]))
    return {
        **{f"{name}s": result for name, result in different.items()},
        "propagations": repeated(one["propagation"]),
        "tuneds": tuned,
        "certificates": tuned.certificate,
        "certificates, two batch dimensions": repeated(tuned.certificate, 2),
        "trihedrals": repeated(one["trihedral"]),
        "frictions, one in flight": jax.vmap(qt.dynamics.FrictionDemand)(
            jnp.array([1 / 3, np.inf]), jnp.array([0.5, np.inf])
        ),
        "tables": qt.Table(each, position=positions, batched=True),
        "tables, components first": qt.Table(
            jnp.asarray(INSTANTS), position=jnp.moveaxis(positions, 2, 0), batched=True, components="first"
        ),
        "reduced": qt.evaluate(tuned.path, INSTANTS, ("speed", "position"), reduce="max", components="first"),
    }


@pytest.fixture(scope="module")
def results():
    return single() | many()


def datasets(results):
    return {name: result.to_xarray({"scenario_sha256": "bc9c"}) for name, result in results.items()}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_result_is_restored_from_its_file_bit_by_bit(results, suffix, tmp_path, monkeypatch):
    monkeypatch.setattr(netcdf, "_require_readable", lambda file: None)  # it starts a process for each file
    for name, dataset in datasets(results).items():
        file = tmp_path / f"{name}{suffix}"
        qt.save_dataset(dataset, file)
        again = qt.load_dataset(file)
        xarray.testing.assert_identical(again, dataset)
        for key, variable in dataset.variables.items():
            if variable.dtype.kind in "fiub":
                assert again[key].dtype == variable.dtype
                assert again[key].values.tobytes() == variable.values.tobytes(), (name, key)


def test_every_dataset_has_meanings_and_provenance(results):
    for name, dataset in datasets(results).items():
        assert dataset.attrs["quaternion_convention"].startswith("scalar first, Hamilton"), name
        assert dataset.attrs["frame_convention"].startswith("right-handed")
        assert dataset.attrs["frame"]
        assert dataset.attrs["versions"].startswith(f"qtraj {qt.__version__}, jax {jax.__version__}, numpy ")
        assert dataset.attrs["dtype"] == "float64"
        assert dataset.attrs["type"] == type(results[name]).__name__
        assert dataset.attrs["scenario_sha256"] == "bc9c"
        for key, variable in dataset.data_vars.items():
            assert variable.attrs["long_name"], (name, key)
            worded = variable.dtype.kind in "UO" or key in UNITS_IN_MEANING
            assert worded or variable.attrs["units"], (name, key)


def test_single_precision_is_reported():
    attitude = jax.tree.map(lambda x: x.astype(jnp.float32), single()["attitude"])
    dataset = attitude.to_xarray()
    assert dataset.attrs["dtype"] == "float32"
    assert dataset["rate"].dtype == np.float32


def test_numbers_agree_with_their_labels(results):
    data = datasets(results)
    tuned, one = data["tuneds"], results["tuned"]
    assert tuned["worst_value"].sel(limit="curvature").values.tolist() == [1 / 3] * BATCH
    assert tuned["limit_unit"].sel(limit="curvature").item() == "m-1"
    assert tuned["start_velocity"].sel(batch=1, world="z").item() == 1 / 3
    assert tuned["outcome"].values.tolist() == ["converged"] * BATCH
    assert tuned["radius"].sel(radius_power=1).values.tolist() == [0.1] * BATCH
    assert data["tuned"]["objective"].item() == float(one.objective)
    assert data["tuned"]["status"].values.tolist() == ["proved", "undefined"]
    assert data["certificates, two batch dimensions"]["status"].dims == ("batch_1", "batch_2", "limit")
    closed = data["closeds"]
    assert closed["quaternion"].dims == ("batch", "sample", "component")
    assert closed["time"].dims == ("batch", "sample")
    assert closed["command"].attrs["units"] == "rad s-2"
    for word in ("quaternion", "error", "angle"):  # the closed form has the same names as the loop
        xarray.testing.assert_identical(data["closed form"][word], data["closed"][word])
    assert data["closed forms"]["error"].dims == ("batch", "sample", "component")
    assert data["open"].attrs["frame"] == "inertial"
    assert data["open"]["result"].item() == results["open"].result
    assert data["closed"]["error"].sel(time=0.1, component="y").item() == 6 / 3 / 5
    assert data["tables, components first"]["position"].dims == ("world", "path", "time")
    assert data["reduced"]["position"].dims == ("world", "path")
    assert data["reduced"]["speed_time"].attrs["units"] == "s"
    assert data["trihedral"]["dcm"].sel(body="normal", world="y").item() == 1.0
    assert data["track"]["time"].values[0] == 7.0
    assert data["state"]["acceleration"].sel(world="z").item() == 1 / 7
    assert data["states"]["position"].dims == ("batch", "world")
    assert "acceleration" not in results["tuned"].start.to_xarray()
    assert data["friction"]["side"].item() == 1 / 3
    assert data["frictions, one in flight"]["total"].dims == ("batch",)
    assert data["frictions, one in flight"]["total"].values.tolist() == [0.5, np.inf]
    assert "residual_horizontal_rms" in data["fitted"]
    assert data["propagations"]["result"].shape == (BATCH,)


def test_a_rate_law_commands_rates():
    one = single()["closed"]
    law = qt.Solution(one.times, one.quaternion, one.rate, 0, one.command, commands="rate")
    assert law.to_xarray()["command"].attrs["units"] == "rad s-1"


def test_an_integral_has_its_own_unit():
    path = single()["path"]
    whole = qt.evaluate(path, INSTANTS, ("speed", "quaternion"), reduce="integral").to_xarray()
    assert (whole["speed"].attrs["units"], whole["quaternion"].attrs["units"]) == ("m", "s")


def test_pandas_and_pyarrow_read_one_row_for_each_problem_and_instant(results, tmp_path):
    for name in ("tuneds", "closeds", "residual"):
        qt.save_dataset(results[name], tmp_path / f"{name}.parquet")
        qt.save_dataset(results[name], tmp_path / f"{name}.csv")
    tuned = pandas.read_parquet(tmp_path / "tuneds.parquet")
    assert tuned["status_slope"].tolist() == ["undefined"] * BATCH
    assert tuned["end_position_y"].tolist() == [10.0] * BATCH
    closed = pandas.read_csv(tmp_path / "closeds.csv", comment="#", **EXACTLY)
    expected = np.asarray(results["closeds"].quaternion)[..., 2].ravel()
    assert len(closed) == BATCH * len(INSTANTS)
    assert np.array_equal(closed["quaternion_y"], expected)
    assert pq.read_schema(tmp_path / "closeds.parquet").field("rate_x").metadata[b"units"] == b"rad s-1"
    assert len(pandas.read_csv(tmp_path / "residual.csv", comment="#")) == 1


def test_a_saved_track_is_read_as_a_recording(results, tmp_path):
    track = results["track"]
    qt.save_dataset(track, tmp_path / "track.csv")
    again = qt.read_track(tmp_path / "track.csv")
    assert all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(again), jax.tree.leaves(track), strict=True))


def test_every_result_has_a_summary_of_one_line(results):
    for name, result in results.items():
        text = repr(result)
        assert text.startswith(f"{type(result).__name__}("), name
        assert len(text) < LONGEST
        assert "\n" not in text
        assert not re.search(r"array|Array|\[", text), text
    one, lots = repr(results["tuned"]), repr(results["tuneds"])
    assert one == "Tuned(converged, objective 0.333333, 7 steps; curvature proved; slope undefined)"
    assert lots.startswith("Tuned(3 problems, all converged, objective 0.333333")
    assert "2 × 3 paths" in repr(results["certificates, two batch dimensions"])
    assert repr(results["open"]).startswith("Solution(3 instants, 0 … 0.333333 s: stopped")
    assert "turn 45.8366°" in repr(results["path"])
    vectors = "position (10, 0, 0.142857) m, velocity (1, 4, 0.333333) m/s, acceleration (0, -1.6, 0.142857) m/s²"
    assert repr(results["state"]) == f"BoundaryState({vectors})"
    assert repr(results["friction"]) == "FrictionDemand(side 0.333333, total 0.5)"
    assert "partly without contact with the road" in repr(results["frictions, one in flight"])


def test_an_incomplete_result_is_still_shown(results):
    tuned = results["tuned"]
    shapes = jax.eval_shape(lambda x: x, tuned)
    half = jax.tree.map(lambda x: None, tuned.certificate)
    torn = jax.tree.map(lambda x: x[None, :0], results["certificate"])
    seen = []
    jax.jit(lambda x: seen.append((repr(x), x._repr_html_())))(tuned)
    for text in (repr(shapes), repr(half), repr(torn), seen[0][0]):
        assert re.match(r"(Tuned|Certificate)\(", text)
    assert seen[0][1].startswith("<pre>Tuned(")


class Tags(HTMLParser):
    """The tags of a page, all of which must be closed."""

    def __init__(self):
        super().__init__()
        self.open, self.seen, self.text = [], set(), ""

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.seen.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_every_result_is_a_small_table_in_a_notebook(results):
    for name, result in results.items():
        page = Tags()
        page.feed(result._repr_html_())
        page.close()
        assert page.open == [], name
        assert page.seen == {"div", "strong", "table", "thead", "tbody", "tr", "th", "td"}
        assert page.text.startswith(f"{type(result).__name__} ")
        assert all(variable in page.text for variable in result.to_xarray().data_vars)


class Hostile(AbstractResult):
    """A result whose texts all come from input."""

    value: jax.Array

    def record(self):
        texts = {HOSTILE: record.Quantity(np.array([HOSTILE]), HOSTILE, HOSTILE, (HOSTILE,))}
        return record.Record(HOSTILE, texts)


def test_texts_from_input_are_escaped():
    hostile = Hostile(jnp.zeros(1))
    page = Tags()
    page.feed(hostile._repr_html_())
    assert "script" not in page.seen
    assert page.text.count(HOSTILE) == 6  # the summary; name, dimension, unit, value and meaning
    torn = jax.tree.map(lambda x: None, hostile)._repr_html_()
    assert torn.startswith("<pre>")
    assert "<script>" not in torn


def test_traced_results_and_a_missing_xarray_are_reported(monkeypatch):
    one = single()
    for name in ("tuned", "table", "closed", "path", "certificate"):
        with pytest.raises(ValueError, match="a dataset needs concrete values"):
            jax.jit(lambda x: x.to_xarray())(one[name])
    original = record.require_package
    monkeypatch.setattr(record, "require_package", lambda package, purpose: original(f"missing_{package}", purpose))
    with pytest.raises(ModuleNotFoundError, match=r"needs missing_xarray: pip install 'qtraj\[io\]'"):
        one["attitude"].to_xarray()


def test_functions_return_results():
    named = {getattr(qt, name) for name in qt.__all__}
    named |= {getattr(qt.control, name) for name in qt.control.__all__} | {qt.dynamics.FrictionDemand}
    classes = {thing for thing in named if isinstance(thing, type) and issubclass(thing, AbstractResult)}
    wanted = {
        qt.Tuned,
        qt.Fitted,
        qt.Certificate,
        qt.Table,
        qt.Solution,
        qt.Propagation,
        qt.Track,
        qt.Trihedral,
        qt.SpiralHelix,
        qt.SlewHistory,
        qt.SlewVerdict,
        qt.LoopHistory,
        qt.LoopVerdict,
        qt.PathChange,
        qt.Route,
        qt.RouteCertificate,
        qt.FittedRoute,
        qt.Retimed,
        qt.SpeedProfile,
        qt.TunedRoute,
        qt.Uncertainty,
        qt.MarginUncertainty,
    }
    wanted |= {
        qt.Atlas,
        qt.BoxCertificate,
        qt.BoxTuned,
        qt.RobustTuned,
        qt.Shape,
        qt.Study,
        qt.ArmMotion,
        qt.Attitude,
        qt.BodyMotion,
        qt.PoseMotion,
        qt.AttitudeResidual,
        qt.RateResidual,
        qt.BoundaryState,
        qt.Residual,
        qt.control.ClosedMotion,
        qt.dynamics.FrictionDemand,
    }
    assert classes == wanted


def test_plain_arrays_are_labelled():
    times = np.array([0.0, 0.5, 1.0, 1.5])
    q0 = [1.0, 0, 0, 0]
    qs = qt.propagate(lambda t: jnp.array([0.0, 0.0, 1.0]), q0, times)
    mu = qt.error_response(qt.RateLaw(1.0), [0.9, 0.1, 0, 0], None, times)
    pushed = (np.ones((2, 4, 3)), "m s-2", "specific force")
    dataset = qt.label(times, {"title": "two"}, quaternion=qs, error=mu, angle=np.zeros(4), felt=pushed)
    assert dataset["quaternion"].dims == ("time", "component")
    assert np.array_equal(dataset["error"].sel(component="w"), mu[:, 0])
    assert dataset["felt"].dims == ("batch", "time", "body")
    assert dataset["felt"].attrs == {"units": "m s-2", "long_name": "specific force"}
    assert dataset["angle"].dims == ("time",)
    assert dataset.attrs["title"] == "two"
    assert dataset.attrs["quaternion_convention"].startswith("scalar first")
    square = qt.label(times, quaternion=np.eye(4), angle=np.eye(4))  # four instants, and a batch of four angles
    assert square["quaternion"].dims == ("time", "component")
    assert square["angle"].dims == ("batch", "time")


@pytest.mark.parametrize(
    ("wrong", "fragment"),
    [
        ({"felt": np.zeros(4)}, "'felt' has no predefined unit"),
        ({}, "at least one array"),
        *(
            ({name: np.zeros(shape)}, f"{name} must have the shape {expected}, but")
            for name, shape, expected in [
                ("rate", (3, 3), "(*batch, 4, 3) or (*batch, 4, 4)"),
                ("acceleration", (4,), "(*batch, 4, 3) or (*batch, 4, 4)"),
                ("quaternion", (4, 3), "(*batch, 4, 4)"),
                ("error", (2, 4), "(*batch, 4, 4)"),
                ("command", (4, 3), "(*batch, 4, 4)"),
                ("torque", (4, 4), "(*batch, 4, 3)"),
                ("force", (4,), "(*batch, 4, 3)"),
                ("angle", (4, 3), "(*batch, 4)"),
            ]
        ),
        ({"felt": (np.zeros((4, 5)), "m", "five")}, "felt must have the shape (*batch, 4) or (*batch, 4, 3)"),
        ({"time": (np.zeros(4), "s", "other times")}, "'time' is the name of a coordinate"),
        ({"body": (np.zeros(4), "m", "a body")}, "'body' is the name of a coordinate"),
        ({"times": [0.0, np.nan, 2.0, 3.0], "angle": np.zeros(4)}, "some of them are NaN"),
    ],
)
def test_arrays_of_wrong_shapes_are_refused(wrong, fragment):
    with pytest.raises(ValueError, match=re.escape(fragment)):
        qt.label(**({"times": np.arange(4.0)} | wrong))


def test_certificates_of_a_batch_can_be_indexed_and_iterated():
    lots = repeated(single()["certificate"])
    assert [found.status["slope"] for found in lots] == ["undefined"] * BATCH
    assert len(lots) == BATCH
    assert lots[-1].worst["curvature"] == (0.1, 1 / 3, 0.5)
    assert lots[jnp.asarray(1)].status == lots[1].status
    for index in (BATCH, -BATCH - 1, np.int64(BATCH), jnp.asarray(BATCH), np.asarray(-BATCH - 1)):
        with pytest.raises(IndexError, match=f"index {index} is out of range: there are 3 paths"):
            lots[index]
    with pytest.raises(TypeError, match="only the certificate of a batch can be indexed"):
        lots[0][0]
    with pytest.raises(TypeError, match="only the certificate of a batch has a length"):
        len(lots[0])


def test_the_words_of_a_summary():
    assert extent(np.array([2.0, 1.0]), "m") == "1 … 2 m"
    assert extent(np.array([1.0, np.nan])) == "1 and others that are not finite"
    assert (extent(np.array(np.nan)), extent(np.zeros(0)), extent(np.array(3))) == ("not finite", "none", "3")
    assert counts_text(np.array(["a", "b", "b"])) == "2 b, 1 a"
    assert counts_text(np.array(["a", "a"])) == "all a"
    assert counts_text(np.array(list("aabcdefg"))) == "2 a, 1 b, 1 c, 1 d, 3 others"


def test_results_are_true_with_and_without_a_batch():
    for result in (single()["tuned"], single()["certificate"]):
        assert bool(result)
        assert bool(repeated(result))


def test_axes_and_commands_of_a_solution_are_checked():
    motion = (INSTANTS, np.ones((len(INSTANTS), 4)), np.ones((len(INSTANTS), 4)), 0)
    with pytest.raises(ValueError, match="axes must be 'body' or 'inertial', but 'earth' was given"):
        qt.Solution(*motion, axes="earth")
    with pytest.raises(ValueError, match="commands must be 'acceleration' or 'rate', but 'torque' was given"):
        qt.Solution(*motion, commands="torque")


def test_every_code_of_a_propagation_has_its_own_text():
    codes = [qt.ResultCode.successful, qt.ResultCode.tolerance_not_reached, qt.ResultCode.not_finite]
    quaternion = np.ones((len(INSTANTS), 4))
    each = [qt.Propagation(*map(jnp.asarray, (INSTANTS, quaternion, 1e-13, 7, code))) for code in codes]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *each)
    texts = [one.result for one in each]
    assert len(set(texts)) == 3
    assert list(batch.result) == batch.record().variables["result"].values.tolist() == texts
    assert [one.record().variables["result"].values.item() for one in each] == texts


@pytest.mark.parametrize("timed", [True, False])
def test_rows_are_batch_elements_but_not_dimensions_of_similar_names(timed):
    dims = ("batch_1", "batch_2", "batch_width", *(["time"] if timed else []))
    values = np.arange(2.0 * 3 * 2 * (4 if timed else 1)).reshape(2, 3, 2, *([4] if timed else []))
    dataset = xarray.Dataset({"x": (dims, values)}, {"time": ("time", np.arange(4.0))} if timed else {})
    flat = flatten(dataset)
    assert flat.header["rows"] == [dim for dim in dims if dim != "batch_width"]
    np.testing.assert_array_equal(flat.columns["x_1"], values[:, :, 1].ravel())
    xarray.testing.assert_identical(unflatten(flat), dataset)
