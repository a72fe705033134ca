"""Tables as data frames, and outputs by their names."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import qtraj as qt

TIMES = np.linspace(0.0, 4.0, 5)
PATH = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
PATHS = jax.vmap(lambda r: qt.SpiralHelix(jnp.stack([r]), [0.0, 0.3], [0.0, 0.5], 10.0))(jnp.array([10.0, 20.0, 30.0]))


def test_outputs_by_their_names():
    table = qt.evaluate(PATH, TIMES, ("position", "curvature"))
    np.testing.assert_array_equal(table["curvature"], table.curvature)
    np.testing.assert_array_equal(table["time"], TIMES)
    assert list(table) == ["position", "curvature"]
    assert "position" in table
    assert "torsion" not in table
    with pytest.raises(KeyError, match="no output 'torsion'; its outputs are position, curvature"):
        table["torsion"]


def test_one_row_for_each_instant():
    table = qt.evaluate(PATH, TIMES, ("position", "quaternion", "curvature", "rate", "dcm"))
    frame = table.to_dataframe()
    assert frame.shape == (5, 1 + 3 + 4 + 1 + 3 + 9)
    np.testing.assert_array_equal(frame["time"], TIMES)
    np.testing.assert_array_equal(frame[["position_x", "position_y", "position_z"]], table.position)
    np.testing.assert_array_equal(frame["quaternion_w"], table.quaternion[:, 0])
    np.testing.assert_array_equal(frame["rate_binormal"], table.rate[:, 2])
    np.testing.assert_array_equal(frame["dcm_normal_x"], table.dcm[:, 1, 0])


@pytest.mark.parametrize("components", ["last", "first"])
@pytest.mark.parametrize("times", [TIMES, np.stack([TIMES, TIMES + 1, TIMES + 2])], ids=["shared", "own"])
def test_the_rows_of_a_batch_are_those_of_its_paths(components, times):
    frame = qt.evaluate(PATHS, times, ("position", "dcm", "speed"), components=components).to_dataframe()
    own = np.broadcast_to(times, (3, 5))
    single = [qt.evaluate(PATHS[k], own[k], ("position", "dcm", "speed")).to_dataframe() for k in range(3)]
    assert frame["path"].tolist() == [k for k in range(3) for _ in range(5)]
    joined = pd.concat(single, ignore_index=True)
    pd.testing.assert_frame_equal(frame.drop(columns="path"), joined, rtol=1e-12)


def test_a_missing_pandas_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"a data frame needs pandas: pip install pandas"):
        qt.evaluate(PATH, TIMES).to_dataframe()
