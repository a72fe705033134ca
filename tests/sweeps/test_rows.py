"""The parameters of points: by their numbers, reproducible, with the distributions that they state."""

import warnings

import numpy as np
import pytest
from scipy import stats

from qtraj.sweeps import Column, Normal, Uniform
from qtraj.sweeps.draws import random_numbers, sobol_numbers
from qtraj.sweeps.parameters import rows_of

SEED = 7


def made(tmp_path, parameters, samples=None, design="random", seed=SEED):
    rows, arrays = rows_of(parameters, samples, design, seed, tmp_path)
    for k, values in enumerate(arrays.values()):
        np.save(tmp_path / f"{k}.npy", values)
    return rows


MIXED = {"a": [1.0, 2.0, 3.0], "n": [4, 5], "x": Uniform(2.0, 3.0), "y": Normal(1.0, 0.1)}


def test_grids_are_a_product_and_the_last_is_the_fastest(tmp_path):
    rows = made(tmp_path, {"a": [1.0, 2.0, 3.0], "n": [4, 5], "on": [False, True]})
    assert rows.count == 12
    points = rows.at(0, 12)
    expected = np.meshgrid([1.0, 2.0, 3.0], [4, 5], [False, True], indexing="ij")
    for values, grid in zip(points.values(), expected, strict=True):
        np.testing.assert_array_equal(values, grid.ravel())
    assert [values.dtype.kind for values in points.values()] == ["f", "i", "b"]


@pytest.mark.parametrize("design", ["random", "latin", "sobol"])
def test_parts_are_those_of_the_whole_and_cells_share_samples(tmp_path, design):
    rows = made(tmp_path, MIXED, 11, design)
    whole = rows.at(0, rows.count)
    assert rows.count == 66
    for size in (1, 4, 7, 11, 13, 40):
        parts = [rows.at(k, min(k + size, 66)) for k in range(0, 66, size)]
        for name, values in whole.items():
            np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), values)
    cells = whole["x"].reshape(6, 11)
    np.testing.assert_array_equal(cells, np.broadcast_to(cells[0], (6, 11)))
    assert np.unique(cells[0]).size == 11


@pytest.mark.parametrize("design", ["random", "latin", "sobol"])
def test_distributions(tmp_path, design):
    points = made(tmp_path, {"x": Uniform(2.0, 3.0), "y": Normal(1.0, 0.1)}, 4096, design).at(0, 4096)
    assert stats.kstest(points["x"], stats.uniform(2.0, 1.0).cdf).pvalue > 1e-3
    assert stats.kstest(points["y"], stats.norm(1.0, 0.1).cdf).pvalue > 1e-3
    assert abs(stats.pearsonr(points["x"], points["y"]).statistic) < 0.05


def test_designs_are_scipys(tmp_path):
    names = {"x": Uniform(0.0, 1.0), "y": Uniform(0.0, 1.0)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sobol = stats.qmc.Sobol(2, rng=SEED).random(100)
    drawn = np.stack([*made(tmp_path, names, 100, "sobol").at(0, 100).values()], 1)
    np.testing.assert_allclose(drawn, sobol, atol=1e-15)
    latin = np.stack([*made(tmp_path, names, 100, "latin").at(0, 100).values()], 1)
    for column in latin.T:  # one sample in each of 100 equal intervals
        assert sorted(np.floor(column * 100).astype(int)) == [*range(100)]


def test_numbers_depend_on_the_seed_and_the_name_and_not_on_the_start():
    whole = random_numbers(SEED, "x", 0, 50)
    for start in (1, 2, 3, 4, 17):
        np.testing.assert_array_equal(random_numbers(SEED, "x", start, 50), whole[start:])
    assert not np.isin(whole, random_numbers(SEED, "y", 0, 50)).any()
    assert not np.isin(whole, random_numbers(SEED + 1, "x", 0, 50)).any()
    assert ((whole > 0) & (whole < 1)).all()
    np.testing.assert_array_equal(sobol_numbers(SEED, 3, 9, 20), sobol_numbers(SEED, 3, 0, 20)[9:])


def test_columns_belong_together_and_functions_follow(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text('"speed",mass\n1.5,10\n2.5,20\n')
    rows = made(
        tmp_path,
        {
            "speed": Column(table, "speed"),
            "mass": Column(table, "mass"),
            "k": [1, 2],
            "momentum": lambda p: p["mass"] * p["speed"],
        },
    )
    points = rows.at(0, rows.count)
    assert points["momentum"].tolist() == [15.0, 50.0, 15.0, 50.0]
    assert points["k"].tolist() == [1, 1, 2, 2]
    assert rows.point(3) == {"speed": 2.5, "mass": 20.0, "k": 2, "momentum": 50.0}


def test_many_points_are_not_stored(tmp_path):
    rows = made(tmp_path, {"a": np.arange(100_000.0), "b": np.arange(100_000.0)})
    assert rows.at(10**10 - 2, 10**10)["b"].tolist() == [99_998.0, 99_999.0]


FAULTS = [
    ({}, {}, "there are no parameters"),
    ({"a": []}, {}, "the parameter 'a' must contain at least one value"),
    ({"a": [1.0, np.nan]}, {}, "the parameter 'a' must be finite, but value 1 is not"),
    ({"a": ["x"]}, {}, "the parameter 'a' must be numbers or bools"),
    ({"a": [[1.0], [2.0, 3.0]]}, {}, "the parameter 'a' must be a list of numbers"),
    ({"a": np.zeros((2, 2))}, {}, "in one dimension"),
    ({"status": [1.0]}, {}, "the name 'status' is reserved"),
    ({"a/b": [1.0]}, {}, "must be a string of letters, digits"),
    ({3: [1.0]}, {}, "the name of a parameter must be a string"),
    ([1.0], {}, "parameters must be a dictionary"),
    ({"a": lambda p: 1.0}, {}, "all parameters are functions"),
    ({"a": Uniform(0, 1)}, {}, "the parameter 'a' is random: pass the number of samples"),
    ({"a": Uniform(0, 1)}, {"samples": 0}, "samples must be a whole number, at least 1"),
    ({"a": [1.0]}, {"samples": 3}, "samples needs a random parameter"),
    ({"a": Column([1.0, 2.0]), "b": Column([1.0])}, {}, "all columns must have the same number of values"),
    ({"a": Column([1.0, 2.0])}, {"samples": 3}, "the columns have 2 values"),
    ({"a": np.arange(1e6), "b": np.arange(1e6)}, {}, "1e\\+12 points, but a sweep has at most"),
    ({"a": Uniform(0, 1)}, {"samples": 10**12}, "1e\\+12 points"),
    ({"a": Uniform(0, 1)}, {"samples": 10**9, "design": "latin"}, "use design='sobol'"),
    ({"a": Uniform(0, 1)}, {"samples": 3, "design": "best"}, "design must be one of random, latin, sobol"),
    ({"a": [1.0]}, {"seed": -1}, "seed must be a whole number"),
]


@pytest.mark.parametrize(("parameters", "options", "message"), FAULTS)
def test_faults(tmp_path, parameters, options, message):
    given = {"samples": None, "design": "random", "seed": 0, **options}
    with pytest.raises(ValueError, match=message):
        rows_of(parameters, folder=tmp_path, **given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Uniform(1.0, 1.0), "low must be less than high"),
        (lambda: Uniform(0.0, np.inf), "high must be a finite number"),
        (lambda: Normal(0.0, -1.0), "sigma must be positive"),
        (lambda: Normal("8", 1.0), "mean must be a finite number"),
    ],
)
def test_faults_of_distributions(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_faults_of_tables(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("a,b\n1,x\n")
    with pytest.raises(ValueError, match=r"table.csv: there is no column 'c'; the columns are a, b"):
        Column(table, "c")
    with pytest.raises(ValueError, match=r"table.csv: the column 'b' must contain numbers only"):
        Column(table, "b")


def test_a_function_of_parameters_must_return_numbers(tmp_path):
    rows = made(tmp_path, {"a": [0.0, 1.0], "b": lambda p: np.log(p["a"] * 0 - 1 + 2 * (p["a"] > 5))})
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="the function of the parameter 'b' returns values"):
        rows.at(0, 2)
    with pytest.raises(ValueError, match="must return one number for each of 2 points"):
        made(tmp_path, {"a": [0.0, 1.0], "b": lambda p: "x"}).at(0, 2)
