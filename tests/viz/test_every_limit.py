"""Every kind of limit is in datasets, files, figures and report tables: none is left out, and each side is named."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.foundation.document import save
from qtraj.io.dataset import path_dataset
from qtraj.viz.history import limits_figure
from qtraj.viz.report.path_tables import path_tables

PATH = qt.SpiralHelix.hermite(
    qt.BoundaryState([20, 0, 0], [1, 6, 0.3]), qt.BoundaryState([0, 20, 1.5], [-7, -1, 0.1]), 4.0
)
CLIMB = qt.Quantity("climb_rate", "m/s", "velocity[2]")
AREA = [(5, -20), (15, -20), (15, 20), (5, 20)]
BRAKES = qt.BySpeed([0, 10, 30], lower=[-4, -3, -2], upper=[4, 3, 2])
OBSTACLES = [qt.Ball([30, 30, 0], 3.0), qt.Ball([14.5, 14.5, 0.8], 1.0)]
KINDS = {
    "sides": ({"longitudinal_acceleration": (-3, 3), "speed": (2, 10)}, "lower limit -3"),
    "lower": ({"speed": (2, None)}, "lower limit 2"),
    "steps": ({"speed": qt.Along([0, 15, 25], [10, 9.5, 10])}, "limit along the way"),
    "pairs": ({"longitudinal_acceleration": qt.Along([0, 15], [(-3, 3), (-2.9, 2.9)])}, "limit along the way"),
    "linear": ({"speed": qt.Along([0, 15, 25], [10, 9.5, 10], kind="linear")}, "limit along the way"),
    "areas": ({"speed": qt.Regions([(AREA, 9.5)], outside=10)}, "limit along the way"),
    "by speed": ({"longitudinal_acceleration": BRAKES}, "limit at this speed"),
    "ellipse": ({"combined_acceleration": qt.Ellipse(4, qt.BySpeed([0, 30], magnitude=[4, 3]), 6)}, "limit 1"),
    "own": ({"own": {CLIMB: (-0.3, 0.4)}}, "upper limit 0.4"),
    "own along": ({"own": {CLIMB: qt.Along([0, 10], [0.6, 0.55])}}, "limit along the way"),
    "obstacles": ({"keep_out": OBSTACLES, "body": [(0.5, 0.4), ((-0.5, 0.1, 0), 0.3)]}, None),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_limit_is_everywhere(kind, tmp_path):
    given, words = KINDS[kind]
    limits = qt.Limits(**given)
    found = qt.certify(PATH, limits)
    assert list(limits.margins(PATH, 1.0)) == list(found.names)
    for value in (limits, found):
        save(value, tmp_path / "stored.toml")
        again = qt.load(tmp_path / "stored.toml")
        assert repr(again) == repr(value)
    dataset = path_dataset({"path": PATH}, limits, findings={"path": found}, samples=33)
    qt.save_dataset(dataset, tmp_path / "paths.nc")
    dataset = qt.load_dataset(tmp_path / "paths.nc")
    rows = path_tables(dataset, {"path": dataset.sel(path="path")}, None)[0].rows
    assert {row[0].split(" [")[0] for row in rows} >= {name.replace("_", " ").split(" [")[0] for name in found.names}
    assert sorted(row[-1] for row in rows) == sorted(found.status.values())
    shown = [float(row[2].replace("−", "-")) for row in rows]
    np.testing.assert_allclose(sorted(shown), sorted(worst[1] for worst in found.worst.values()), rtol=1e-5)
    legends = [text.get_text() for axes in limits_figure(dataset).axes for text in axes.get_legend().get_texts()]
    assert words is None or words in legends
