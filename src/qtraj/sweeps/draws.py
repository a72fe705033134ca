"""Draw random numbers by index, so that each shard of a sweep draws only its own rows.

The same index always has the same numbers, whatever the size of a shard and the order of the shards.
"""

import hashlib
import warnings

import numpy as np

DESIGNS = ("random", "latin", "sobol")
"""How samples are drawn: independently, as a Latin hypercube, or as a scrambled Sobol sequence."""

MOST_LATIN = 20_000_000
"""Maximum number of values of a Latin hypercube, which is drawn as a whole."""

MOST_SOBOL = 2**30
"""Maximum number of samples of a Sobol sequence with 30 bits."""

_PER_STEP = 4
"""Numbers that Philox draws at each step of its counter."""

_SMALLEST = 2.0**-54
"""The distance from 0 and 1 of the smallest and the largest number."""


def random_numbers(seed: int, name: str, start: int, stop: int) -> np.ndarray:
    """Return numbers `start` to `stop` of the independent uniform numbers in (0, 1) of a parameter.

    They depend on the seed and on the name of the parameter only. Philox is a generator with a counter, so it starts
    anywhere at once.
    """
    digest = hashlib.sha256(f"{seed}:{name}".encode()).digest()
    generator = np.random.Philox(key=np.frombuffer(digest[:16], "<u8").astype(np.uint64))
    first = start // _PER_STEP
    generator.advance(first)
    drawn = np.random.Generator(generator).random(stop - _PER_STEP * first)
    return drawn[start - _PER_STEP * first :] + _SMALLEST


def sobol_numbers(seed: int, dimensions: int, start: int, stop: int) -> np.ndarray:
    """Return points `start` to `stop` of a scrambled Sobol sequence in (0, 1), (stop - start, dimensions)."""
    from scipy.stats import qmc  # imported here, because it delays the import of qtraj

    sequence = qmc.Sobol(dimensions, scramble=True, rng=seed)
    if start:
        sequence.fast_forward(start)
    with warnings.catch_warnings():  # that the number of points is not a power of 2; the whole sequence counts
        warnings.simplefilter("ignore", UserWarning)
        drawn = sequence.random(stop - start)
    return np.clip(drawn, _SMALLEST, 1 - _SMALLEST)


def latin_numbers(seed: int, dimensions: int, samples: int) -> np.ndarray:
    """Return a Latin hypercube in (0, 1), (samples, dimensions)."""
    from scipy.stats import qmc  # imported here, because it delays the import of qtraj

    drawn = qmc.LatinHypercube(dimensions, rng=seed).random(samples)
    return np.clip(drawn, _SMALLEST, 1 - _SMALLEST)
