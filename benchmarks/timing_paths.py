"""`retime` on random regular paths of every kind, against the exact minimum duration and TOPPRA.

    python -m benchmarks.timing_paths
    python -m benchmarks.timing_paths --paths 2000 --toppra 100 --jerk 200
    python -m benchmarks.timing_paths --braking 3 --toppra 0 --jerk 0
    python -m benchmarks.timing_paths --paths 0 --jerk 0 --toppra 0 --ipopt 24
    python -m benchmarks.timing_paths --first 400 --paths 400 --jerk 0 --toppra 0

The paths are those of `random_paths`, from rest to rest, with limits on the speed and on the lateral and longitudinal
acceleration; with `--braking`, the limit on braking is this multiple of that on acceleration. The exact duration is
computed by a forward and a backward pass on 200 000 samples. Cubic curves are timed again over another parameter, which
slows at random. `--first` is the first seed, so that parts of a long sweep can run alone. TOPPRA (extra `dev`)
gets 1 000 equidistant grid points; its limits are then evaluated between them. With a limit on the jerk, the duration
is compared with that for a tenfold smaller tolerance, or with that of IPOPT (CasADi, extra `dev`) on a fine grid, which
starts from the timing of `retime`, so that it can only confirm or improve it.
"""

import argparse
import itertools
import sys
import time

import jax
import numpy as np

import qtraj as qt
from benchmarks.random_paths import exact_duration, random_path, reparametrised
from benchmarks.timing_toppra import OfSpline, sampled_excess, with_toppra

GRID, NODES = 1000, 1500
"""Numbers of intervals for TOPPRA, and of nodes for IPOPT at least."""


def timed(path, **options):
    """The fastest timing from rest to rest and the processor time [s]; None if a straight line reverses.

    With a limit on the jerk, also None if rounding errors next to almost coincident points look like jumps.
    """
    start = time.process_time()
    try:
        found = qt.retime(qt.Route.from_piecewise(path.spline), qt.Limits(**path.limits), 0.0, 0.0, **options)
    except ValueError as error:
        if "the velocity of the route is zero at" in str(error) or "route jumps at" in str(error):
            return None
        raise
    return found, time.process_time() - start


def quantiles(name, values, unit=""):
    """Print the median, the 90 % quantile and the extremes."""
    if not len(values):
        return
    low, middle, high, most = np.quantile(values, [0.0, 0.5, 0.9, 1.0])
    print(f"  {name}: median {middle:.3g}{unit}, 90 % below {high:.3g}{unit}, {low:.3g} to {most:.3g}{unit}")


def random_paths(first, count, braking):
    """Compare with the exact durations, and with those of the same curves over other parameters.

    `braking` is the ratio of the limits on braking and acceleration. The seeds start at `first`.
    """
    refused, failed, gaps, claimed, seconds, cells, changes = 0, [], [], [], [], [], []
    for seed in reported(range(first, first + count)):
        path = random_path(seed)
        path = path if braking == 1 else path.braking(braking)
        result = timed(path)
        if result is None:
            refused += 1
            continue
        found, taken = result
        gap = float(found.duration) / exact_duration(path) - 1
        if found.code != qt.ResultCode.successful or not -2e-3 < gap < 5e-3:
            failed.append((seed, int(found.code), gap))
        gaps.append(gap)
        claimed.append(float(found.gap))
        seconds.append(1e3 * taken)
        cells.append(found.timing.knots.size - 1)
        other = reparametrised(path, seed)
        again = None if other is None else timed(other)
        if again is not None:
            changes.append(float(again[0].duration) / float(found.duration) - 1)
            if again[0].code != qt.ResultCode.successful or abs(changes[-1]) > 1e-3:
                failed.append((seed, int(again[0].code), changes[-1], "over another parameter"))
    print(f"{count} random paths: {refused} reverse on a straight line and are refused")
    print("  not proved, not within 0.5 % of the exact duration, or changed by more than 0.1 % by another parameter:")
    print(f"    {len(failed)} {failed[:20]}")
    quantiles("longer than the exact duration by", gaps)
    quantiles("estimate `gap`", claimed)
    quantiles(f"change by another parameter, for {len(changes)} of them", np.abs(changes))
    quantiles("processor time", seconds, " ms")
    quantiles("cells", cells)


def reported(seeds):
    """Yield the seeds, and count them on a terminal."""
    for k, seed in enumerate(seeds):
        if sys.stderr.isatty():
            print(f"  {k} of {len(seeds)} paths", end="\r", file=sys.stderr, flush=True)
        yield seed


def paths_with_jerk(first, points=40):
    """Yield seeds and random paths with a limit on the jerk."""
    for seed in itertools.count(first):
        path = random_path(seed, points)
        if path.kinds[2] == "cubic hermite":  # its acceleration jumps
            continue
        jerk = path.limits["longitudinal_acceleration"] * np.exp(np.random.default_rng(seed + 1).uniform(-1, 2))
        path.limits["jerk"] = float(jerk)
        yield seed, path


def with_jerk(first, count):
    """Compare with the durations for a tenfold smaller tolerance."""
    failed, changes, seconds = [], [], []
    for seed, path in paths_with_jerk(first):
        if len(changes) == count:
            break
        result, fine = timed(path), timed(path, tolerance=1e-4)
        if result is None or fine is None:
            continue
        change = float(result[0].duration) / float(fine[0].duration) - 1
        if max(int(result[0].code), int(fine[0].code)) or abs(change) > 5e-3:
            failed.append((seed, int(result[0].code), int(fine[0].code), change))
        changes.append(change)
        seconds.append(1e3 * result[1])
    print(f"{count} random paths with a limit on the jerk")
    print(f"  not proved, or not within 0.5 % of the duration for the tolerance 1e-4: {len(failed)} {failed[:5]}")
    quantiles("longer by", changes)
    quantiles("processor time", seconds, " ms")


def beside_ipopt(first, count):
    """Compare with IPOPT on a grid that divides the cells of `retime`, and starts from its timing."""
    from benchmarks.timing_in_casadi import with_ipopt

    failed, unsolved, changes, excess, steps, seconds, own = [], [], [], [], [], [], []
    for seed, path in paths_with_jerk(first):
        if len(own) == count:
            break
        result = timed(path)
        if result is None:
            continue
        own.append(1e3 * result[1])
        u, a, slope = divided(result[0].timing, NODES)
        start = time.process_time()
        found = with_ipopt(path.spline, u + path.spline.x[0], a, slope, path.limits)
        if not found.converged:
            unsolved.append(seed)
            continue
        seconds.append(time.process_time() - start)
        steps.append(found.steps)
        change = float(result[0].duration) / found.duration - 1
        if int(result[0].code) or change > 5e-3:
            failed.append((seed, int(result[0].code), change, found.usage))
        changes.append(change)
        excess.append(found.usage)
        print(f"    seed {seed}: longer by {change:.1e}, IPOPT's largest usage {found.usage:.4f}", file=sys.stderr)
    print(f"{len(own)} random paths with a limit on the jerk: IPOPT solves {len(changes)}, and not {unsolved[:20]}")
    print(f"  not proved, or longer than IPOPT's duration by more than 0.5 %: {len(failed)} {failed[:20]}")
    quantiles("longer than IPOPT's duration by", changes)
    print(f"  shorter than IPOPT's duration: {int(np.sum(np.array(changes) < 0))} of {len(changes)}")
    quantiles("IPOPT's largest ratio of a quantity to its limit between its nodes", excess)
    quantiles("IPOPT's steps", steps)
    quantiles("processor time of IPOPT", seconds, " s")
    quantiles("processor time of `retime`, proofs included", own, " ms")


def divided(timing, count):
    """Return at least `count` parameters that divide the cells of a timing, and u̇² and its derivative there."""
    knots, c = np.asarray(timing.knots), np.asarray(timing.coefficients)
    z = np.arange(int(np.ceil(count / len(c)))) / np.ceil(count / len(c))
    h, rising = np.diff(knots)[:, None], c[:, 1:] * [1, 2, 3] / np.diff(knots)[:, None]
    u = np.append((knots[:-1, None] + h * z).ravel(), knots[-1])
    a = np.append((c @ z ** np.arange(4)[:, None]).ravel(), c[-1].sum())
    return u, np.maximum(a, 0.0), np.append((rising @ z ** np.arange(3)[:, None]).ravel(), rising[-1].sum())


def beside_toppra(count):
    """Compare with TOPPRA on the same paths."""
    excess, own, other, ratio = [], [], [], []
    for seed in range(count):
        path = random_path(seed)
        result = timed(path)
        if result is None:
            continue
        own.append(1e3 * result[1])
        spline = OfSpline(path.spline)
        found = with_toppra(spline, np.linspace(0.0, spline.duration, GRID + 1), path.limits)
        other.append(1e3 * found.processor)
        if np.isfinite(found.duration):
            excess.append(1 + sampled_excess(spline, found, path.limits))
            ratio.append(found.duration / float(result[0].duration))
    print(f"TOPPRA with {GRID} intervals on {len(own)} of these paths: {len(ratio)} solved")
    quantiles("largest ratio of a quantity to its limit between the grid points", excess)
    quantiles("duration, relative to that of `retime`", ratio)
    quantiles("processor time of TOPPRA", other, " ms")
    quantiles("processor time of `retime`, proofs included", own, " ms")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--braking", type=float, default=1.0)
    parser.add_argument("--jerk", type=int, default=20)
    parser.add_argument("--toppra", type=int, default=20)
    parser.add_argument("--ipopt", type=int, default=0)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    np.seterr(all="ignore")
    if given.paths:
        random_paths(given.first, given.paths, given.braking)
    if given.jerk:
        with_jerk(given.first, given.jerk)
    if given.toppra:
        beside_toppra(given.toppra)
    if given.ipopt:
        beside_ipopt(given.first, given.ipopt)


if __name__ == "__main__":
    main()
