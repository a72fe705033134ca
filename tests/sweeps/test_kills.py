"""Interrupted sweeps: the store is the same as without interruptions, and nothing is computed twice."""

import pytest
from benchmarks.sweeps import full_disk, killed_sweep

pytest.importorskip("distributed")

SEED, SHARDS, WORKER_KILLS, CLIENT_KILLS = 3, 40, 6, 2


@pytest.mark.slow
def test_killed_workers_and_clients(tmp_path):
    found = killed_sweep(tmp_path, WORKER_KILLS, CLIENT_KILLS, SHARDS, SEED)
    assert found.good, found
    assert found.calls >= SHARDS
    assert f"{CLIENT_KILLS} clients" in found.interruptions
    assert not found.interruptions.startswith("0 workers")


@pytest.mark.slow
def test_a_full_disk(tmp_path):
    try:
        found = full_disk(tmp_path, SHARDS)
    except PermissionError as error:
        pytest.skip(str(error))
    assert found.good, found
    assert found.calls >= SHARDS
