"""Simulate many flights with random values, and collect them in a `Study`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.foundation.argument import described, is_whole, require_type
from qtraj.foundation.arrays import as_float, concrete, real_scalar, require_positive
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.in_blocks import in_blocks
from qtraj.foundation.outcome import ResultCode
from qtraj.foundation.types import ArrayInput
from qtraj.motion.simulation.loop_verdict import SETTLED
from qtraj.motion.simulation.solution import Solution
from qtraj.motion.simulation.study import Study

BLOCK = 256
"""Number of flights that are simulated at once."""

Spread = ArrayInput | Callable[[jax.Array], Any]


@of_one_device
def monte_carlo(
    flight: Callable[..., Solution],
    spreads: Mapping[str, Spread],
    n: int,
    key: Any = 0,
    *,
    metric: Callable[[Solution], Any] | None = None,
    settled: float = SETTLED,
    block: int = BLOCK,
) -> Study:
    """Simulate `n` flights with random values, compiled and in batches, and find percentiles and the worst flights.

    Args:
        flight: A function that simulates one flight with `simulate`, and returns its `Solution`. It is called with one
            keyword argument for each spread. If it has an argument `key`, it also receives a key of `jax.random`, such
            as for the noise of a `Sensor`.
        spreads: For each argument, the standard deviation of a normal distribution with mean 0, a scalar or an array
            with the shape of the argument, or a function that draws a value from a key, such as
            `lambda key: jax.random.uniform(key, (3,))`.
        n: The number of flights.
        key: A key of `jax.random`, or an integer. Flight k depends only on `key` and k, not on `n`.
        metric: A function of a `Solution` that returns a number, larger for worse flights; by default the last attitude
            error [rad].
        settled: The attitude error [rad] below which a flight counts as settled, by default 1°.
        block: The number of flights that are simulated at once, which bounds the memory.

    Returns:
        A `Study`: attitude errors, settling times, percentiles, the worst flights with their causes, and the drawn
        values; `to_xarray()` converts it to a dataset.

    Raises:
        ValueError: For a spread that is negative or not finite, a function that draws the same value for all flights,
            no spread at all, or `n` or `block` that is not a positive integer.
        TypeError: If `flight` lacks an argument for a spread, or does not return a `Solution`.
    """
    for value, name in ((n, "n"), (block, "block")):
        if not is_whole(value) or value < 1:
            raise ValueError(f"{name} must be a positive integer, but {value!r} was given")
    require_type(spreads, Mapping, "spreads", "a dictionary from argument to spread")
    require_positive(real_scalar(settled, "settled"), "settled", "rad")
    if not callable(flight):
        raise TypeError(f"flight must be a function that returns the Solution of simulate, but is {described(flight)}")
    with_key = _accepts_key(flight, [*spreads])
    sources = {name: _source(name, spread) for name, spread in spreads.items()}
    if not sources and not with_key:
        raise ValueError("all flights would be the same: pass spreads, or a flight with an argument key")
    first = jax.random.key(key) if is_whole(key) else key
    require_type(first, jax.Array, "key", "a key of jax.random or a whole number")

    def draw(number: Any) -> dict[str, Any]:
        own = jax.random.fold_in(first, number)
        keys = jax.random.split(own, len(sources) + 1)
        values = {name: source(keys[k]) for k, (name, source) in enumerate(sources.items())}
        return values | ({"key": _raw(keys[-1])} if with_key else {})

    draws = jax.jit(jax.vmap(draw))(jnp.arange(n))
    for name, spread in spreads.items():
        _require_random(name, spread, draws[name])

    def run(values: dict[str, Any]) -> tuple[Any, ...]:
        motion = flight(**values)
        if not isinstance(motion, Solution) or motion.angle is None:
            raise TypeError(f"flight must return the Solution of simulate, but returned {type(motion).__name__}")
        measure = motion.angle[-1] if metric is None else jnp.asarray(metric(motion))
        if measure.shape != ():
            raise ValueError(f"metric must return a number, but returned shape {measure.shape}")
        times = motion.settling_time(settled), motion.peak_command
        return motion.times, motion.angle, measure, *times, motion.code

    columns: Any = jax.tree.map(np.asarray, in_blocks(run, draws, block=block))
    times, angle, measure, settling, peak, code = columns
    measure: Any = np.where(np.isfinite(measure) & (code == ResultCode.successful), measure, np.inf)
    sizes = {name: _sizes(draws[name], spread) for name, spread in spreads.items()}
    return Study(times[0], angle, measure, settling, peak, code, draws, sizes)


def _source(name: str, spread: Spread) -> Callable[[jax.Array], Any]:
    if callable(spread):
        return spread
    sigma = as_float(spread)
    values = concrete(sigma)
    if values is not None and not (np.isfinite(values).all() and (values >= 0).all()):
        raise ValueError(
            f"the spread {name!r} must be a standard deviation, not negative and finite, but {spread!r} was given"
        )
    return lambda key: sigma * jax.random.normal(key, sigma.shape, jnp.result_type(float))


def _require_random(name: str, spread: Spread, values: Any) -> None:
    """Raise a ValueError if a function drew the same numbers for all flights, as one of NumPy does."""
    drawn = np.asarray(values)
    if callable(spread) and len(drawn) > 1 and drawn.dtype.kind == "f" and (drawn == drawn[0]).all():
        raise ValueError(
            f"the function of the spread {name!r} drew the same value for all flights: draw with jax.random and "
            "the key that it receives, not with numpy.random"
        )


def _sizes(values: Any, spread: Spread) -> np.ndarray:
    """Return the size of each draw: its norm in standard deviations, for a function in those of the sample."""
    flat = np.asarray(values, float).reshape(len(values), -1)
    if callable(spread):
        flat, sigma = flat - flat.mean(axis=0), flat.std(axis=0)
    else:
        sigma = np.broadcast_to(np.ravel(np.asarray(spread, float)), flat.shape[1:])
    return np.linalg.norm(np.where(sigma > 0, flat / np.where(sigma > 0, sigma, 1.0), 0.0), axis=1)


def _raw(key: jax.Array) -> jax.Array:
    return jax.random.key_data(key) if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else key


def _accepts_key(flight: Callable[..., Any], names: list[str]) -> bool:
    """Return whether `flight` has an argument `key`; raise a TypeError if it lacks an argument for a spread."""
    if "key" in names:
        raise ValueError("'key' is the key of a flight, not a spread: choose another name")
    try:
        signature = inspect.signature(flight)
    except (TypeError, ValueError):
        return False
    for options in ({"key": None}, {}):
        try:
            signature.bind(**dict.fromkeys(names), **options)
        except TypeError:
            continue
        return bool(options)
    expected = f"the arguments {', '.join(names)}, one for each spread," if names else "no arguments without a default"
    raise TypeError(f"flight must have {expected} but its signature is {signature}")
