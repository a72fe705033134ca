"""Measure what a sweep adds to calls of its function, and how much faster two workers are than one.

`pytest benchmarks/test_sweeps.py -n 0 -s` prints the ratios. On other machines, run it while nothing else runs.
"""

import time

import jax.numpy as jnp
import pytest

import qtraj as qt
from benchmarks.sweeps import turn
from qtraj.foundation.cores import CORES
from qtraj.sweeps.draws import random_numbers
from qtraj.sweeps.local_cluster import local_client

SHARD, SHARDS, ROUNDS = 2**17, 8, 3
TUNED, TUNED_SHARDS = 128, 48
"""Points of a shard of tunings, and its shards."""

OVERHEAD, SPEEDUP = 1.1, 1.7
"""Largest ratio of a sweep to calls of its function, and smallest ratio of one worker to two."""

RADIUS, RATE = qt.sweeps.Uniform(5.0, 20.0), qt.sweeps.Uniform(-0.2, 0.2)
TIMES = 33


def path(point):
    """A spiral with this radius and its rate of change."""
    radius = jnp.stack([point["radius"], point["rate"]])
    return qt.SpiralHelix(radius, jnp.array([0.0, 0.4, 0.02]), jnp.array([0.0, 0.5]), 4.0)


EVALUATED = qt.sweeps.evaluate(path, ("speed", "curvature", "lateral_acceleration"), instants=TIMES)


def swept(folder, **options):
    parameters = {"radius": RADIUS, "rate": RATE}
    return qt.sweep(EVALUATED, parameters, folder, samples=SHARD * SHARDS, shard=SHARD, keep=False, **options)


def tuned(folder, shards, client):
    """Tunings, whose arrays fit the cache: two processes that evaluate long arrays also share the memory's speed."""
    parameters = {"radius": qt.sweeps.Uniform(9.0, 15.0), "speed": qt.sweeps.Uniform(4.0, 6.0)}
    function, options = qt.sweeps.tune(turn, starts=2), {"keep": False, "client": client}
    return qt.sweep(function, parameters, folder, samples=TUNED * shards, shard=TUNED, **options)


def test_overhead(tmp_path):
    points = {
        "radius": RADIUS.from_unit(random_numbers(0, "radius", 0, SHARD)),
        "rate": RATE.from_unit(random_numbers(0, "rate", 0, SHARD)),
    }
    EVALUATED(points)  # compiles
    swept(tmp_path / "first", workers=0)  # compiles its trial of one point
    ratios = []
    for k in range(ROUNDS):
        began = time.process_time()
        for _ in range(SHARDS):
            EVALUATED(points)
        middle = time.process_time()
        assert swept(tmp_path / str(k), workers=0).successful
        ratios.append((time.process_time() - middle) / (middle - began))
    print(f"\na sweep takes {min(ratios):.3f} to {max(ratios):.3f} times as long as the calls of its function")
    assert min(ratios) <= OVERHEAD


@pytest.mark.skipif(CORES < 2, reason="two workers need two cores")
def test_two_workers(tmp_path):
    pytest.importorskip("distributed")
    spent = {}
    for workers in (1, 2):
        with local_client(workers) as client:  # as `sweep` starts it: one thread for each worker
            client.wait_for_workers(workers)
            tuned(tmp_path / f"warm-{workers}", 2 * workers, client)  # each worker imports
            began = time.perf_counter()
            assert tuned(tmp_path / str(workers), TUNED_SHARDS, client).successful
            spent[workers] = time.perf_counter() - began
    print(f"\ntwo workers are {spent[1] / spent[2]:.2f} times as fast as one")
    assert spent[1] / spent[2] >= SPEEDUP
