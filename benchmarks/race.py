"""Find the loosest setting that is accurate enough, and compare run times.

Run times are noisy, so the candidates alternate in each round, and medians are compared; best times are printed too.
"""

import time

import jax
import numpy as np


def loosest(call, settings, error, target):
    """Return the first of `settings`, from loose to tight, with error(call(setting)) ≤ target, and this error."""
    found = first_within((error(jax.block_until_ready(call(setting))) for setting in settings), target)
    if found is None:
        raise ValueError(f"none of the settings reaches {target:g}, not even the last, {settings[-1]!r}")
    return settings[found[0]], found[1]


def first_within(errors, target):
    """Return the index of the first error ≤ target and this error, or None if there is none."""
    return next(((k, error) for k, error in enumerate(errors) if error <= target), None)


def decades(first, last, each=4):
    """Return tolerances from 10^first down to 10^last, `each` per decade."""
    return [10.0 ** (first - k / each) for k in range((first - last) * each + 1)]


def seconds(call):
    """Return the time [s] from a call until its result is ready."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start


def race(runners, rounds, few=(), warm=True):
    """Return the run times [s] of each runner by name, one for each round.

    With `warm`, each runner is called once before the first round. Runners in `few` run only in the first two rounds.
    """
    spent = {name: [] for name in runners}
    if warm:
        for call in runners.values():
            seconds(call)
    for k in range(rounds):
        for name, call in runners.items():
            if k < 2 or name not in few:
                spent[name].append(seconds(call))
    return spent


def report(title, spent, remarks, unit=1e3):
    """Print medians and best times, and the ratio of each median to the first one; return these ratios."""
    names = list(spent)
    medians = {name: float(np.median(times)) for name, times in spent.items()}
    ratios = {name: medians[name] / medians[names[0]] for name in names}
    print(f"\n{title}")
    for name in names:
        best = min(spent[name]) * unit
        print(
            f"  {name:34s} {medians[name] * unit:10.3f} ms (best {best:10.3f})  x{ratios[name]:8.1f}  {remarks[name]}"
        )
    return ratios
