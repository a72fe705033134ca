"""Atlases of known regions: every point of the fine grid, the border, the cost, and what is missed."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.sweeps.atlas.quadtree import Quadtree, boundary

LATERAL = 1.5  # [m/s²]


def axes(tolerance=0.01, steps=16):
    return qt.AtlasAxis("x", -1.0, 1.3, tolerance, steps), qt.AtlasAxis("y", -1.2, 1.0, tolerance, steps)


def grid(found):
    """All points of the grid with the tolerance of an atlas."""
    lines = [
        np.linspace(axis.low, axis.high, n + 1)
        for axis, n in zip((found.x_axis, found.y_axis), found.cells, strict=True)
    ]
    return np.meshgrid(*lines, indexing="ij")


REGIONS = {
    "disc": lambda x, y: x**2 + y**2 < 0.81,
    "ring": lambda x, y: abs(np.hypot(x, y) - 0.87) < 0.04,
    "islands": lambda x, y: np.sin(9 * x) * np.sin(7 * y + x) > 0.1,
    "half plane": lambda x, y: y > 0.7 * x + 0.123,
    "thin and winding": lambda x, y: abs(y - 0.3 * np.sin(14 * x)) < 0.03,
    "corner": lambda x, y: (x > 0.111) & (y > 0.222),
    "everything": lambda x, y: x < 9,
}


@pytest.mark.parametrize("name", REGIONS)
def test_the_atlas_equals_the_fine_grid(name):
    found = qt.atlas(REGIONS[name], *axes())
    x, y = grid(found)
    np.testing.assert_array_equal(found.at(x, y)["status"] == "feasible", REGIONS[name](x, y))
    assert found.evaluations == len({(a, b) for a, b in found.lattice.tolist()})
    exact = REGIONS[name](x, y).mean()
    assert found.shares.get("feasible", 0.0) == pytest.approx(exact, abs=0.02)


def test_the_border_is_the_closed_form_within_the_tolerance_at_a_twentieth_of_the_cost():
    """On a circle, v² / R ≤ a: the border of entry speed against radius is v = √(a R)."""
    radius = qt.AtlasAxis("radius", 10.0, 50.0, tolerance=0.2, unit="m")
    speed = qt.AtlasAxis("speed", 2.0, 12.0, tolerance=0.05, unit="m/s")
    found = qt.atlas(lambda r, v: v**2 / r <= LATERAL, radius, speed)
    [line] = found.border
    r, v = line.T
    near = np.minimum(abs(v - np.sqrt(LATERAL * r)), abs(r - v**2 / LATERAL) * speed.tolerance / radius.tolerance)
    assert near.max() <= speed.tolerance / 2
    assert (line[0, 0], line[-1, 0]) in {(10.0, 50.0), (50.0, 10.0)}  # it crosses the whole atlas
    steps = abs(np.diff(line, axis=0))
    assert (steps <= [radius.tolerance, speed.tolerance]).all()
    assert found.evaluations <= 0.05 * (found.cells[0] + 1) * (found.cells[1] + 1)


def test_the_cost_grows_with_the_border_and_not_with_the_area():
    counts = [qt.atlas(REGIONS["disc"], *axes(t)).evaluations for t in (0.04, 0.02, 0.01, 0.005)]
    growth = np.diff(counts)
    assert (growth[1:] < 2.2 * growth[:-1]).all()
    assert (growth[1:] > 1.8 * growth[:-1]).all()


def test_borders_are_lines_or_closed():
    disc = qt.atlas(REGIONS["disc"], *axes())
    [circle] = disc.border
    np.testing.assert_allclose(circle[0], circle[-1])
    assert abs(np.hypot(*circle.T) - 0.9).max() < 0.01
    assert len(qt.atlas(REGIONS["ring"], *axes()).border) == 2
    assert qt.atlas(REGIONS["everything"], *axes()).border == []
    [straight] = qt.atlas(REGIONS["half plane"], *axes()).border
    assert abs(straight[:, 1] - 0.7 * straight[:, 0] - 0.123).max() < 0.01


def test_a_border_that_enters_a_cell_between_its_corners_is_followed():
    """The tip of a parabola ends in the middle of a coarse cell, which has four equal corners."""

    def tip(x, y):
        return x - 0.52 > 30 * (y + 0.09) ** 2

    found = qt.atlas(tip, qt.AtlasAxis("x", 0.0, 1.0, 0.01, 4), qt.AtlasAxis("y", -0.5, 0.5, 0.01, 4))
    x, y = grid(found)
    assert not any(tip(a, b) for a in (0.5, 0.75) for b in (-0.25, 0.0))
    np.testing.assert_array_equal(found.at(x, y)["status"] == "feasible", tip(x, y))


def test_a_leaf_knows_the_points_of_its_neighbours():
    tree = Quadtree((2, 1), 2)
    tree.divide({(i, j): int(i > 4) for i, j in tree.wanted()})
    assert tree.mixed
    tree.divide(dict.fromkeys(tree.wanted(), 0))
    assert boundary((0, 0, 4), tree.kinds) == [(0, 0), (4, 0), (4, 2), (4, 4), (0, 4)]
    assert boundary((4, 0, 2), tree.kinds) == [(4, 0), (6, 0), (6, 2), (4, 2)]


def test_an_island_below_the_coarse_cells_is_missed_and_the_result_says_so():
    def island(x, y):
        return np.hypot(x - 0.03, y - 0.03) < 0.02

    coarse = qt.atlas(island, *axes())
    assert coarse.shares == {"infeasible": 1.0}
    assert "Regions smaller than the coarse cells, 0.14375 × 0.1375, may be missing." in coarse.result
    assert "feasible" in qt.atlas(island, *axes(steps=150)).shares


def classes(x, y):
    status = np.select(
        [x < -0.4, x < 0.2, x < 0.7, x < 1.0], ["feasible", "sampled", "infeasible", "undecided"], "failed"
    )
    limit = np.where(x < 0.2, "", np.where(y > 0.1, "speed", "curvature + speed"))
    return {"status": status, "first_limit": limit, "duration": 3 * x - 2 * y, "margin": np.where(x < 0.7, y, np.nan)}


def test_classes_limits_and_values_are_read_between_the_points():
    found = qt.atlas(classes, *axes(0.02), follow="limit")
    x, y = grid(found)
    exact, read = classes(x, y), found.at(x, y)
    for name in ("status", "first_limit"):
        np.testing.assert_array_equal(read[name], exact[name])
    np.testing.assert_allclose(read["duration"][x < -0.5], exact["duration"][x < -0.5], atol=1e-12)  # linear
    assert np.isnan(read["margin"][x > 0.72]).all()
    assert sum(found.shares.values()) == pytest.approx(1.0)
    [border] = found.border  # between sampled and infeasible
    assert abs(border[:, 0] - 0.2).max() < 0.02
    assert sorted(found.limit_names) == ["", "curvature + speed", "speed"]


@pytest.mark.parametrize(("follow", "lines"), [("feasible", [0.2]), ("status", [-0.4, 0.2, 0.7, 1.0])])
def test_only_the_wanted_borders_are_followed(follow, lines):
    found = qt.atlas(classes, *axes(0.02), follow=follow)
    fine = found.leaves[found.leaves[:, 2] == 1]
    middles = found.x_axis.at(fine[:, 0] + 0.5, found.cells[0])
    nearest = np.array(lines)[np.argmin(abs(middles[:, None] - lines), axis=1)]
    assert abs(middles - nearest).max() < 0.03
    assert set(nearest) == set(lines)


def test_points_are_computed_once_and_in_batches():
    seen = []

    def counted(x, y):
        seen.append(len(x))
        return x**2 + y**2 < 0.5

    reports = []
    found = qt.atlas(counted, *axes(), batch=100, progress=reports.append)
    assert max(seen) == 100
    assert sum(seen) == found.evaluations
    assert reports[0].done == 100
    assert str(reports[0]) == "100 of 289 points of the atlas"
    whole = qt.atlas(REGIONS["disc"], *axes())
    assert qt.atlas(REGIONS["disc"], *axes(), batch=7).lattice.tolist() == whole.lattice.tolist()


def test_an_atlas_that_is_too_large_ends_and_says_so():
    found = qt.atlas(REGIONS["islands"], *axes(), max_evaluations=2000)
    assert found.evaluations <= 2000
    assert not bool(found.successful)
    assert "pass a larger max_evaluations or tolerance" in found.result
    assert all(len(line) > 1 for line in found.border)
    with pytest.raises(ValueError, match="289 points, but max_evaluations is 288"):
        qt.atlas(REGIONS["disc"], *axes(), max_evaluations=288)


@pytest.mark.parametrize("suffix", ["json", "toml"])
def test_an_atlas_is_saved_without_loss(tmp_path, suffix):
    found = qt.atlas(classes, *axes(0.1), follow="limit")
    found.save(tmp_path / f"atlas.{suffix}")
    same = qt.load(tmp_path / f"atlas.{suffix}")
    for field in dataclasses.fields(found):
        own, read = getattr(found, field.name), getattr(same, field.name)
        if field.name == "values":
            assert all(np.array_equal(own[k], read[k], equal_nan=True) for k in {*own, *read})
        else:
            assert np.array_equal(own, read)
    assert same.result == found.result


def test_an_atlas_is_a_dataset_of_its_points_and_its_border():
    radius = qt.AtlasAxis("radius", 10.0, 50.0, 2.0, unit="m")
    speed = qt.AtlasAxis("speed", 2.0, 12.0, 0.5, unit="m/s")
    found = qt.atlas(lambda r, v: {"status": v**2 < LATERAL * r, "duration": r / v}, radius, speed)
    data = found.to_xarray()
    assert data.speed.attrs["units"] == "m s-1"
    np.testing.assert_array_equal(data.duration, data.radius / data.speed)
    assert set(data.status.values) == {"feasible", "infeasible"}
    np.testing.assert_allclose(np.stack([data.border_x, data.border_y], 1), np.concatenate(found.border))
    assert "radius × speed" in repr(found)


def test_functions_of_jax_and_slices_of_a_third_parameter():
    shares = [qt.atlas(lambda x, y, r=r: jnp.hypot(x, y) < r, *axes(0.05)).shares["feasible"] for r in (0.3, 0.6, 0.9)]
    np.testing.assert_allclose(shares, np.pi * np.array([0.3, 0.6, 0.9]) ** 2 / (2.3 * 2.2), rtol=0.05)


X = qt.AtlasAxis("x", 0.0, 1.0, 0.1)
Y = qt.AtlasAxis("y", 0.0, 1.0, 0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qt.atlas(lambda x, y: x > y, X, X), "different names, but both are 'x'"),
        (lambda: qt.atlas(lambda x, y: x > y, X, (0, 1)), "must be AtlasAxis"),
        (lambda: qt.atlas(lambda x, y: x > y, X, Y, follow="limits"), "did you mean 'limit'"),
        (lambda: qt.atlas(lambda x, y: x > y, X, Y, batch=0), "batch must be 1 or more"),
        (lambda: qt.atlas(lambda x, y: True, X, Y), "shape \\(\\), one entry|the shape \\(\\)"),
        (lambda: qt.atlas(lambda x, y: {"duration": x}, X, Y), "must return 'status', but it returned duration"),
        (lambda: qt.atlas(lambda x, y: x, X, Y), "is not a class of points"),
        (lambda: qt.atlas(lambda x, y: {"status": x > y, "t": x[1:]}, X, Y), "'t' must have the shape"),
        (lambda: qt.atlas(lambda x, y: {"status": x > y, "t": x.astype(str)}, X, Y), "'t' of an atlas must be real"),
        (lambda: qt.atlas(lambda x, y: {"status": x > y, "x": x}, X, Y), "'x' is a value and an axis"),
        (lambda: qt.atlas(lambda x, y: {"status": x > y, f"n{len(x)}": x}, X, Y, batch=200), "the same values for all"),
        (lambda: qt.atlas(lambda x, y: x > y, X, Y).at(2.0, 0.5), "contains x from 0.0 to 1.0, but not 2.0"),
        (lambda: qt.atlas(lambda x, y: x > y, X, Y).at(np.nan, 0.5), "but not nan"),
        (lambda: qt.AtlasAxis("", 0, 1, 0.1), "name of an axis must be a text"),
        (lambda: qt.AtlasAxis("x", 1, 1, 0.1), "must end above its start"),
        (lambda: qt.AtlasAxis("x", 0, np.inf, 0.1), "high of the axis 'x' must be a finite number"),
        (lambda: qt.AtlasAxis("x", 0, 1, 0.0), "tolerance of the axis 'x' must be positive"),
        (lambda: qt.AtlasAxis("x", 0, 1, "small"), "must be a finite number, but 'small'"),
        (lambda: qt.AtlasAxis("x", 0, 1, 1e-30), "is too small for cells of 0.0625"),
        (lambda: qt.AtlasAxis("x", 0, 1, 0.1, steps=0), "steps of the axis 'x' must be an integer from 1"),
        (lambda: qt.AtlasAxis("x", 0, 1, 0.1, unit="mph"), "'mph' is not a unit"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


def test_cells_that_cannot_be_numbered_are_refused():
    def border(levels):
        axes = (qt.AtlasAxis(name, 0.0, 1.0, tolerance=2.0**-levels) for name in "xy")
        return qt.atlas(lambda x, y: x + y < 0.9, *axes, max_evaluations=2000)

    found = border(30)
    assert found.at([0.1, 0.8], [0.1, 0.8])["status"].tolist() == ["feasible", "infeasible"]
    with pytest.raises(ValueError, match=r"at most .* can be numbered: pass larger tolerances"):
        border(31)
