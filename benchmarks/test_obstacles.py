"""Compare `tune_route` around obstacles with IPOPT on one problem; `benchmarks.obstacles_in_casadi` compares 20."""

import pytest

pytest.importorskip("casadi")

from benchmarks.obstacles_in_casadi import case, compared

EXCESS = 5e-3


def test_the_objective_is_the_same_as_that_of_ipopt():
    """On the same sides of the masts; IPOPT enters them between its instants, while the result is proved."""
    row = compared(case(0))
    assert row.status == "proved"
    assert row.depth > 0
    assert abs(row.same) < EXCESS
    assert row.best < EXCESS
