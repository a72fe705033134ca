"""Exact proofs on random paths: 50-digit arithmetic contradicts none, and would detect a wrong one."""

import mpmath
import numpy as np
import pytest
from benchmarks import exact_proofs


@pytest.mark.parametrize("kind", exact_proofs.KINDS)
def test_no_proof_of_a_random_path_is_contradicted(kind):
    counts, wrong = exact_proofs.check(np.random.default_rng(1), kind, 4)
    assert wrong == []
    assert counts.total() >= 4 * (len(exact_proofs.NAMES) - len(exact_proofs.LONG))
    assert {status for _, status in counts} == {"proved", "broken"}


@pytest.mark.parametrize("kind", ["uniform", "hermite"])
def test_no_proof_of_a_batch_is_contradicted(kind):
    counts, wrong = exact_proofs.check(np.random.default_rng(2), kind, 12, batch=True)
    assert wrong == []
    assert {status for _, status in counts} == {"proved", "broken"}


@pytest.mark.parametrize("kind", exact_proofs.KINDS)
def test_a_wrong_status_is_detected(kind):
    rng = np.random.default_rng(3)
    with mpmath.workdps(exact_proofs.DIGITS):
        exact = exact_proofs.Exact(exact_proofs.random_path(rng, kind))
        for name in exact_proofs.NAMES:
            peak = exact_proofs.value_of(name, exact.largest(name))
            for factor, wrong, right in ((1 - 1e-12, "proved", "broken"), (1 + 1e-12, "broken", "proved")):
                limit = float(peak * factor)
                assert exact_proofs.contradicted(exact, name, limit, wrong, 0.0, rng), name
                assert not exact_proofs.contradicted(exact, name, limit, right, 0.0, rng), name
