"""Measure and print the tables of docs/accuracy.md; with --write, also update the page."""

import argparse
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

from . import closed_loop, derivatives, programs, propagation, recorded_gyro  # noqa: E402
from .tables import put  # noqa: E402

DOCS = Path(__file__).parents[2] / "docs"
TABLES = {
    "turns": programs.turns,
    "brute force": programs.brute_force,
    "frames": programs.frames,
    "coning": propagation.coning,
    "fast coning": propagation.fast_coning,
    "orders": propagation.orders,
    "closed loop": closed_loop.loops,
    "settling": closed_loop.settling,
    "gradients": derivatives.gradients,
    "gyro": recorded_gyro.gyro,
}


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__)
    parser.add_argument("--write", action="store_true", help="update docs/accuracy.md and docs/figures")
    parser.add_argument("names", nargs="*", help=f"{', '.join(TABLES)}, or names of figures; default: all")
    given = parser.parse_args()
    for name, measure in TABLES.items():
        if given.names and name not in given.names:
            continue
        start = time.perf_counter()
        body = measure()
        print(f"\n{name} ({time.perf_counter() - start:.0f} s)\n{body}", flush=True)
        if given.write:
            file = DOCS / "accuracy.md"
            file.write_text(put(file.read_text(encoding="utf-8"), name, body), encoding="utf-8")
    if given.write:
        from qtraj.viz.figures import save

        from .figures import FIGURES

        for name, draw in FIGURES.items():
            if not given.names or name in given.names:
                save(draw(), DOCS / "figures" / f"{name}.svg")


if __name__ == "__main__":
    main()
