"""The outcome of a tuning: texts of one problem and of a batch, errors on request, older files."""

import dataclasses
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

import qtraj as qt
from qtraj.path.vehicle_data import batch_of, vehicle_from, with_batch

LIMITS = qt.Limits(speed=9.0, curvature=0.2)
CODES = [
    qt.ResultCode.successful,
    qt.ResultCode.infeasible,
    qt.ResultCode.not_converged,
    qt.ResultCode.azimuths_equal,
]


def tuned(code=qt.ResultCode.successful, radius=10.0):
    path = qt.SpiralHelix([radius], [0.0, 0.4], [0.0, 0.5], 5.0)
    return qt.Tuned(path, path.state(0.0), path.state(5.0), 0.0, qt.certify(path, LIMITS), code, 7)


@pytest.fixture(scope="module")
def batch():
    return jax.tree.map(lambda *x: jnp.stack(x), *(tuned(code, 2.0 + k) for k, code in enumerate(CODES)))


def test_the_texts_of_a_batch_are_those_of_its_elements(batch):
    assert list(batch.status) == ["converged", "infeasible", "not converged", "ill-posed"]
    assert str(batch).startswith("4 tunings: 1 converged, 1 infeasible, 1 not converged, 1 ill-posed\n")
    assert list(batch.result) == [batch[k].result for k in range(len(CODES))]
    assert batch.result[3] == f"ill-posed: {qt.ResultCode.azimuths_equal.text}"
    assert "the limit on curvature is broken: 0.227758" in batch[2].result
    assert "tune this problem alone" in batch.result[1]


def test_a_failed_element_raises_only_on_request(batch):
    assert batch.successful.tolist() == [True, False, False, False]
    assert batch.converged.tolist() == [True, False, False, False]
    with pytest.raises(RuntimeError, match=r"element 1 of the batch: infeasible: .*curvature is 0\.284"):
        batch.check()
    assert batch[0].check().status == "converged"


def test_a_violated_limit_raises_on_request(batch):
    assert qt.certify(batch[3].path, LIMITS, throw=True).met
    with pytest.raises(RuntimeError, match="the limit on curvature is broken"):
        qt.certify(batch[0].path, LIMITS, throw=True)
    start, end = qt.BoundaryState([12.0, 0.0, 0.0], [0.0, 5.0, 0.0]), qt.BoundaryState([0.0, 12.0, 1.5], [-4.5, 0, 0.2])
    with pytest.raises(RuntimeError, match=r"infeasible: .* What would help"):
        qt.tune(start, end, qt.Limits(curvature=0.02, lateral_acceleration=0.1), starts=1, throw=True)


def test_the_result_of_a_certificate_is_its_worst_finding(batch):
    codes = batch.certificate.code
    assert codes.tolist() == [qt.ResultCode.limits_broken] * 3 + [qt.ResultCode.successful]
    assert batch.certificate.result[3] == "every limit is proved to be satisfied on the whole path."
    assert "the limit on curvature is broken: 0.359551" in batch.certificate.result[0]
    assert jax.jit(lambda c: c.successful)(batch.certificate).tolist() == [False, False, False, True]
    with pytest.raises(RuntimeError, match="element 0 of the batch: a limit is violated"):
        batch.certificate.check()


def test_a_tiny_violation_is_printed():
    path = tuned().path
    _, peak, _ = qt.certify(path, LIMITS).worst["curvature"]
    certificate = qt.certify(path, qt.Limits(curvature=peak * (1 - 2e-9)))
    assert certificate.status == {"curvature": "broken"}
    assert "(relative violation 2.0e-09)" in certificate.result
    assert "relative violation" not in qt.certify(path, qt.Limits(curvature=0.9 * peak)).result


def test_a_standstill_gives_a_warning_if_a_limit_divides_by_the_speed():
    start, end = (
        qt.BoundaryState([12.0, 0.0, 0.0], [0.0, 5.0, 0.0]),
        qt.BoundaryState([0.0, 12.0, 1.5], [0.0, 0.0, 0.0]),
    )
    best = qt.tune(start, end, qt.Limits(curvature=0.001), motion="hermite", duration=4.0, starts=1)
    assert not best.converged
    assert "The velocity at the end is zero: curvature may grow without bound there, or limits may " in best.result
    assert "max_steps" not in best.result


def test_a_result_stores_the_vehicle_of_its_limits_and_older_files_have_none(tmp_path):
    vehicle = qt.Vehicle(2e3, (1.0, 2.0, 2.5), friction=0.7)
    current = dataclasses.replace(tuned(), vehicle=vehicle)
    current.save(tmp_path / "new.toml")
    assert eqx.tree_equal(qt.load(tmp_path / "new.toml"), current)
    fields = tomllib.loads((tmp_path / "new.toml").read_text())
    del fields["vehicle"]
    (tmp_path / "old.toml").write_text(tomli_w.dumps(fields))
    assert eqx.tree_equal(qt.load(tmp_path / "old.toml"), tuned())
    dataset = current.to_xarray()
    assert dataset["vehicle_friction"].values.tolist() == [0.7, 0.7]
    assert dataset["vehicle_inertia"].attrs["units"] == "kg m2"
    assert eqx.tree_equal(vehicle_from(dataset), vehicle)


def test_an_element_of_a_batch_has_its_own_vehicle():
    masses, ones = jnp.asarray([1e3, 2e3]), jnp.ones(2)
    vehicle = qt.Vehicle(1e3, 5.0, bank=0.1)
    mixed = eqx.tree_at(lambda v: v.mass, vehicle, masses)  # one mass for each, the rest shared
    assert batch_of(mixed) == (2,)
    assert batch_of(vehicle) == batch_of(None) == ()
    expected = jax.vmap(lambda m, x: qt.Vehicle(m, 5.0 * x, bank=0.1))(masses, ones)
    assert eqx.tree_equal(with_batch(mixed, 2), expected)
    both = jax.tree.map(lambda *x: jnp.stack(x), tuned(), tuned())
    assert eqx.tree_equal(dataclasses.replace(both, vehicle=expected)[1].vehicle, qt.Vehicle(2e3, 5.0, bank=0.1))


@pytest.mark.parametrize(("old", "code"), [(0, "successful"), (1, "infeasible"), (2, "not_converged")])
def test_older_files_load_with_their_meaning(tmp_path, old, code):
    file = tmp_path / "tuned.toml"
    current = tuned(qt.ResultCode[code])
    current.save(file)
    assert eqx.tree_equal(qt.load(file), current)
    file.write_text(tomli_w.dumps(tomllib.loads(file.read_text()) | {"code": old}))
    assert eqx.tree_equal(qt.load(file), current)


@pytest.mark.parametrize("old", range(5))
def test_older_motion_files_load_with_their_meaning(tmp_path, old):
    names = ("successful", "max_steps_reached", "step_too_small", "near_zero_error", "wrong_sign")
    current = qt.Solution(np.arange(3.0), np.ones((3, 4)), np.ones((3, 4)), qt.ResultCode[names[old]])
    current.save(tmp_path / "motion.toml")
    text = tomllib.loads((tmp_path / "motion.toml").read_text()) | {"code": old}
    (tmp_path / "motion.toml").write_text(tomli_w.dumps(text))
    assert eqx.tree_equal(qt.load(tmp_path / "motion.toml"), current)
