"""Tune with every set of one, two or three of nine limits, for both motions, without further compilation.

`.venv/bin/pytest benchmarks/test_limit_sets.py -n 0 -s` prints run times, memory maps and peak resident memory.
"""

import itertools
import resource
import time
from pathlib import Path

import pytest

import qtraj as qt

RATE = 0.45
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, RATE * 20, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-RATE * 28, -1.0, 0.1])
SOON = {"duration": (2.0, 8.0)}
LOOSE = {
    "curvature": 0.06,
    "torsion": 0.2,
    "speed": 12.0,
    "acceleration": 9.0,
    "lateral_acceleration": 4.0,
    "longitudinal_acceleration": 3.0,
    "slope": 0.5,
    "angular_rate": 1.5,
    "angular_acceleration": 6.0,
}
SETS = [given for k in (1, 2, 3) for given in itertools.combinations(LOOSE, k)]
MAPS = Path("/proc/self/maps")

MORE_MAPS, MORE_MEMORY = 100, 30e6
"""Maximum increase of the memory maps and of the peak memory [bytes] of a process after the first set."""


def kept():
    """Return the number of memory maps of this process, and its peak resident memory [bytes]."""
    return len(MAPS.read_text().splitlines()), 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@pytest.mark.skipif(not MAPS.exists(), reason="only Linux lists the memory maps of a process")
@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_sets_of_limits_share_what_is_compiled(motion):
    def tuned(given):
        limits = qt.Limits(**{name: LOOSE[name] for name in given})
        return qt.tune(START, END, limits, motion=motion, bounds=SOON, starts=1)

    begun = time.perf_counter()
    tuned(SETS[0])
    first, (maps, memory) = time.perf_counter() - begun, kept()
    begun = time.perf_counter()
    ended = [tuned(given).status for given in SETS[1:]]
    rest, (maps_after, memory_after) = time.perf_counter() - begun, kept()
    print(
        f"\n{motion}: the first set {first:.1f} s, {len(ended)} more {rest:.1f} s "
        f"({', '.join(f'{ended.count(x)} {x}' for x in sorted(set(ended)))}); maps {maps} → {maps_after}, "
        f"memory {memory / 1e6:.0f} → {memory_after / 1e6:.0f} MB"
    )
    assert maps_after - maps < MORE_MAPS
    assert memory_after - memory < MORE_MEMORY
