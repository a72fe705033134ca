"""Convert results of the library to outputs of a sweep: numbers and arrays by name."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from qtraj.foundation.outcome import FAILURES
from qtraj.path.quantity import QUANTITIES

Outputs = dict[str, Any]


class NoValidPointError(ValueError):
    """No point of a batch is valid; the message is that of the first one."""


UNITS = {
    "duration": "s",
    "start_velocity": "m s-1",
    "end_velocity": "m s-1",
    "start_speed": "m s-1",
    "end_speed": "m s-1",
    "final_angle": "rad",
    "peak_angle": "rad",
    **{f"worst_{name}": entry.unit for name, entry in QUANTITIES.items()},
}
"""Units of outputs."""


def of_certificate(certificate: Any) -> Outputs:
    """Return whether all limits are proved to be satisfied, and the worst value of each limited quantity."""
    worst = {f"worst_{name}": np.asarray(value) for name, (_, value, _) in certificate.worst.items()}
    return {"holds": np.asarray(certificate.holds), **worst}


def of_codes(codes: Any) -> Outputs:
    """Return the codes of results, and which of them are failures."""
    codes = np.asarray(codes, np.int32)
    return {"code": codes, "failed": codes >= FAILURES}


def of_tuned(best: Any) -> Outputs:
    """Return the outputs of a result of `tune`, for one problem or a batch."""
    return {
        "objective": np.asarray(best.objective),
        "duration": np.asarray(best.path.duration),
        "start_velocity": np.asarray(best.start.velocity),
        "end_velocity": np.asarray(best.end.velocity),
        **of_certificate(best.certificate),
        **of_codes(best.code),
    }


def of_robust(found: Any, of_path: Callable[[Any], Outputs] = of_tuned) -> Outputs:
    """Return the outputs of a result of `robust_tune`: those of the tuned path, and what holds for the deviations.

    `of_path` returns the outputs of the tuned path, `of_route` for a result of `robust_tune_route`.

    `holds`: for intervals, whether all limits are proved for all of them; for standard deviations, whether the wanted
    share of the samples satisfies all limits. `sampled_share`: this share; there is none for intervals.
    """
    outputs = {**of_path(found.tuned), "holds": np.asarray(bool(found.successful)), **of_codes(found.code)}
    share = getattr(found, "sampled_share", None)
    return outputs if share is None else {**outputs, "sampled_share": np.asarray(share)}


def of_route(best: Any) -> Outputs:
    """Return the outputs of a result of `tune_route`."""
    found = {"objective": np.asarray(best.objective), "duration": np.asarray(best.path.duration)}
    return {**found, **of_certificate(best.certificate), **of_codes(best.code)}


def of_timing(timed: Any, certificate: Any) -> Outputs:
    """Return the outputs of a result of `retime`, with the certificate of all limits."""
    start, end = np.asarray(timed.speeds)
    found = {"duration": np.asarray(timed.duration), "start_speed": start, "end_speed": end}
    return {**found, **of_certificate(certificate), **of_codes(timed.code)}


def of_flights(angle: np.ndarray, command: np.ndarray, code: np.ndarray) -> Outputs:
    """Return the outputs of closed loops: attitude errors (n, m) [rad], peak commands (n,) and codes (n,)."""
    measured = {"final_angle": angle[:, -1], "peak_angle": angle.max(axis=1), "peak_command": command}
    return {**measured, **of_codes(code)}


def stacked(rows: Sequence[Outputs]) -> Outputs:
    """Return the outputs of single points as those of a batch."""
    return {name: np.stack([row[name] for row in rows]) for name in rows[0]}


def joined(parts: Sequence[Outputs]) -> Outputs:
    """Return the outputs of several batches as those of one."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def valid(function: Callable[[Any], Any], items: Mapping[int, Any]) -> dict[int, Any]:
    """Return the results of a function for all items for which it raises no ValueError.

    **Raises:** NoValidPointError if it raises one for all items.
    """
    found, first = {}, None
    for place, item in items.items():
        try:
            found[place] = function(item)
        except ValueError as error:
            first = first or error
    if not found:
        raise NoValidPointError(str(first)) from first
    return found


def computed(run: Callable[[list[Any]], Outputs], tasks: Mapping[int, Any], count: int) -> Outputs:
    """Return the outputs of `count` points from those of `tasks`, by the numbers of their points; all others failed.

    The tasks are run together; if this raises a ValueError, one after the other, and those that raise one fail.

    **Raises:** NoValidPointError if no task can be computed.
    """
    try:
        return spread(run([*tasks.values()]), [*tasks], count)
    except ValueError:  # of some task, or because these tasks cannot be one batch
        parts = valid(lambda task: run([task]), tasks)
        return spread(joined([*parts.values()]), [*parts], count)


def spread(outputs: Outputs, places: Sequence[int], count: int) -> Outputs:
    """Return outputs of some of the points as outputs of all of them; the others failed."""
    if len(places) == count:
        return dict(outputs)
    failed = np.ones(count, bool)
    failed[places] = outputs.get("failed", False)
    whole: Outputs = {}
    for name, values in outputs.items():
        fill = np.nan if values.dtype.kind == "f" else -1 if values.dtype.kind == "i" else 0
        whole[name] = np.full((count, *values.shape[1:]), fill, values.dtype)
        whole[name][places] = values
    return whole | {"failed": failed}


def merged(one: Outputs, other: Outputs, rows: np.ndarray) -> Outputs:
    """Return the outputs of `one` at the points in `rows` (n,), and those of `other` at the rest."""
    parts = {True: one, False: other}
    if "failed" in one.keys() | other.keys():
        parts = {own: {"failed": np.zeros(int((rows == own).sum()), bool)} | x for own, x in parts.items()}
    if parts[True].keys() != parts[False].keys():
        raise ValueError(f"points have different outputs: {', '.join(one)}, and {', '.join(other)}")
    whole: Outputs = {}
    for name, values in parts[True].items():
        whole[name] = np.empty((len(rows), *values.shape[1:]), values.dtype)
        whole[name][rows], whole[name][~rows] = values, parts[False][name]
    return whole
