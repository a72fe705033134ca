"""`python -m benchmarks.evaluation [--instants N] [--rounds R] [--json FILE]`: the race, in one run.

Position, velocity, acceleration, quaternion, curvature, torsion and rate of one path: 17 channels (18 for qtraj, which
also writes the component of the rate that is zero). All are warm, take turns, and are compared before they are timed.
"""

import argparse
import json
import platform

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import qtraj as qt  # noqa: E402

from ..race import race  # noqa: E402
from .reference import ANGLE, CHANNELS, DURATION, HEIGHT, RADIUS, Kernel, numpy_and_scipy  # noqa: E402


def runners(kind, instants):
    """Name → call, for one kind of float."""
    times = np.linspace(0.0, DURATION, instants).astype(kind)
    path = qt.SpiralHelix(*[np.asarray(c, kind) for c in (RADIUS, ANGLE, HEIGHT)], np.asarray(DURATION, kind))
    given, table, out = jax.numpy.asarray(times), {}, np.zeros((CHANNELS, instants), kind)

    def again():
        table["old"] = qt.evaluate(path, given, reuse=table.get("old"))
        return table["old"]

    calls = {
        "qtraj": lambda: qt.evaluate(path, given),
        "qtraj, reuse": again,
        "qtraj, reduce": lambda: qt.evaluate(path, given, reduce="max"),
        "NumPy + SciPy": lambda: numpy_and_scipy(times),
    }
    if Kernel.available():
        plain, vectorised = Kernel(kind, True), Kernel(kind, False)
        check(qt.evaluate(path, given), plain.evaluate(times, out), kind)
        calls |= {
            "C": lambda: plain.evaluate(times, out),
            "C, fresh memory": lambda: plain.evaluate(times, np.empty_like(out)),
            "C, vectorised sincos": lambda: vectorised.evaluate(times, out),
            "C, maxima": lambda: plain.peaks(times),
            "C, maxima, vectorised sincos": lambda: vectorised.peaks(times),
            "writing alone": lambda: vectorised.fill(out),
        }
    return calls


def check(table, channels, kind):
    """Refuse to race what does not agree."""
    rate = np.asarray(table.rate)
    ours = np.concatenate(
        [
            *(np.asarray(x).T for x in (table.position, table.velocity, table.acceleration, table.quaternion)),
            np.asarray(table.curvature)[None],
            np.asarray(table.torsion)[None],
            rate.T[[0, 2]],
        ]
    )
    scale = np.abs(channels).max(axis=1, keepdims=True)
    worst = float(np.max(np.abs(ours - channels) / scale))
    if not worst < (1e-11 if kind == "float64" else 2e-3):
        raise ValueError(f"the results disagree by {worst:.3g} in {kind}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--instants", type=int, default=4_000_000)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json")
    options = parser.parse_args()
    results = {
        "machine": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        "device": str(jax.devices()[0]),
        "versions": {"qtraj": qt.__version__, "jax": jax.__version__, "numpy": np.__version__},
        "instants": options.instants,
        "ns_per_instant": {},
    }
    for kind in ("float64", "float32"):
        spent = race(runners(kind, options.instants), options.rounds)
        scale = 1e9 / options.instants
        rows = {n: {"median": float(np.median(t)) * scale, "best": min(t) * scale} for n, t in spent.items()}
        results["ns_per_instant"][kind] = rows
        first = rows["qtraj"]
        print(f"\n{kind}, {options.instants} instants: ns per instant (median, best) and qtraj's ratio to it")
        for name, row in rows.items():
            ratios = f"{first['median'] / row['median']:6.2f} {first['best'] / row['best']:6.2f}"
            print(f"  {name:30s} {row['median']:8.1f} {row['best']:8.1f}   x {ratios}")
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
