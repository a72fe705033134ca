"""Create a feedback law from its name; the gains can be specified in several ways."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any

from qtraj.foundation.types import ArrayInput
from qtraj.motion.control.baselines import BASELINES
from qtraj.motion.control.errors import KINDS as LINEAR
from qtraj.motion.control.gains import from_damping, from_settling_time, from_weights, rate_from_settling_time
from qtraj.motion.control.laws import AbstractLaw, AccelerationLaw, RateLaw

RATE = "rate"
LAWS = (*LINEAR, RATE, *BASELINES)
"""The names of all feedback laws."""


def feedback_law(
    kind: str = "body",
    *,
    k1: ArrayInput | None = None,
    k2: ArrayInput | None = None,
    k: ArrayInput | None = None,
    settling_time: ArrayInput | None = None,
    residual: ArrayInput | None = None,
    damping: ArrayInput | None = None,
    frequency: ArrayInput | None = None,
    weights: Mapping[str, ArrayInput] | None = None,
) -> AbstractLaw:
    """Create a feedback law from its name, as in `feedback_law("inertial", settling_time=10.0)`.

    The `kind` "body", "inertial" or "additive" is an `AccelerationLaw` with this error, "rate" is a `RateLaw`, and
    "quaternion", "geometric" and "logarithmic" are `QuaternionFeedback`, `GeometricFeedback` and `LogarithmicFeedback`.
    Specify the gains in one of four ways; a rate law needs `k` or `settling_time`.

    - `k1` [1/s] and `k2` [1/s²], or `k` [1/s] of a rate law: the gains;
    - `settling_time` [s]: the time in which the critically damped error decays to the fraction `residual`, by default
      0.02, of its initial value;
    - `damping`: the damping ratio, and `frequency` [rad/s]: the undamped natural frequency;
    - `weights`: the weights "error" [1/s⁴], "rate" [1/s²] (by default 0) and "command" (by default 1) of a
      linear-quadratic regulator, by name.

    See `from_settling_time`, `rate_from_settling_time`, `from_damping` and `from_weights` for the formulas.

    **Raises:** ValueError for an unknown kind; if the gains are missing, incomplete, specified in several ways or in a
    way that the law does not support; for a `residual` without `settling_time`; and for invalid values.
    """
    if kind not in LAWS:
        raise ValueError(
            f"the kind of a feedback law must be one of {', '.join(map(repr, LAWS))}, but {kind!r} was given"
        )
    arguments = {"k1": k1, "k2": k2, "k": k, "settling_time": settling_time}
    arguments |= {"damping": damping, "frequency": frequency, "weights": weights}
    way = _way(kind, [name for name, value in arguments.items() if value is not None])
    if residual is not None and settling_time is None:
        raise ValueError("'residual' requires 'settling_time', which is missing")
    options = {} if residual is None else {"residual": residual}
    gains = _ways(kind)[way](*(arguments[name] for name in way), **options)
    return _law(kind, gains)


def _from_table(weights: Mapping[str, ArrayInput]) -> tuple[Any, Any]:
    """Return the gains K1 and K2 of a linear-quadratic regulator from the weights by name."""
    names = ("error", "rate", "command")
    if not isinstance(weights, Mapping) or "error" not in weights or not weights.keys() <= set(names):
        raise ValueError(
            f"weights must be a table with 'error' and optionally 'rate' and 'command', but {weights!r} was given"
        )
    return from_weights(**weights)


WAYS: Mapping[tuple[str, ...], Callable[..., Any]] = MappingProxyType(
    {
        ("k1", "k2"): lambda k1, k2: (k1, k2),
        ("settling_time",): from_settling_time,
        ("damping", "frequency"): from_damping,
        ("weights",): _from_table,
    }
)
"""The ways to specify k1 and k2: the arguments of each way, and the function that computes the gains from them."""
RATE_WAYS: Mapping[tuple[str, ...], Callable[..., Any]] = MappingProxyType(
    {("k",): lambda k: k, ("settling_time",): rate_from_settling_time}
)
"""The ways to specify the gain of a rate law."""


def _ways(kind: str) -> Mapping[tuple[str, ...], Callable[..., Any]]:
    return RATE_WAYS if kind == RATE else WAYS


def _way(kind: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return the key of `WAYS` or `RATE_WAYS` that consists of the specified arguments `names`.

    **Raises:** ValueError if no key matches, if several keys match, if only a part of a key is specified, or if a law
    of this kind does not support the key.
    """
    ways = _ways(kind)
    text = ", or ".join(" and ".join(way) for way in ways)
    used = [way for way in {**WAYS, **RATE_WAYS} if set(way) & set(names)]
    for way in used:
        if way not in ways:
            raise ValueError(f"{way[0]!r} cannot be used with a law of kind {kind!r}: specify {text}")
    if not used:
        raise ValueError(f"there are no gains: specify {text}")
    if len(used) > 1:
        first = ", ".join(next(name for name in way if name in names) for way in used)
        raise ValueError(f"the gains are specified in several ways ({first}): specify only one of {text}")
    for name in used[0]:
        if name not in names:
            raise ValueError(f"{name!r} is missing: {' and '.join(used[0])} must be specified together")
    return used[0]


def _law(kind: str, gains: Any) -> AbstractLaw:
    if kind == RATE:
        return RateLaw(gains)
    k1, k2 = gains
    return AccelerationLaw(k1, k2, kind) if kind in LINEAR else BASELINES[kind](k1, k2)
