"""The answers that an earlier commit gave to random problems, repeated; see `benchmarks/stored_answers`.

A status may change only from "undecided" to another status, which is checked with 60 digits for certificates of
spiral-helices. Times of maxima are not compared, because a quantity can
attain its maximum at several instants; nor are tuned paths, because another path can be as good.
"""

import numpy as np
import pytest
from benchmarks.stored_answers import GROUPS, stored
from benchmarks.stored_answers.digits import contradiction

import qtraj as qt
from qtraj.design.proof.certificate import STATUSES
from qtraj.path.quantity import quantity

COMMIT, STORED = stored()
UNDECIDED = STATUSES.index("undecided")
SUCCESSFUL = int(qt.ResultCode.successful)

VALUE = 1e-9
"""Relative tolerance of largest values; values below the limit are compared relative to the limit."""

LOWER, HIGHER = 1e-3, 1e-1
"""The same for quantities with the divisor |r' × r''|, which have narrow peaks: both searches miss some of them."""

OBJECTIVE, SMALL = 1e-9, 1e-10
"""Relative and absolute tolerance by which an objective of `tune` may be larger than before."""

ROUTE_OBJECTIVE = 1e-6
"""Relative tolerance by which an objective of `tune_route` may be larger than before; its tightening stops at 1e-6."""

DURATION, WITH_SPEEDS = 1e-6, 1e-5
"""Relative tolerances by which a duration of `retime` may be longer than before: in general, and with speeds prescribed
at the ends, which are exact now, and were upper bounds in the stored problems."""

RESIDUAL, FIT = 1e-6, 1e-5
"""Relative tolerances of residuals of fits, and of numbers that are not stationary at the best fit."""

QUICK = (
    "certificates.uniform_1",
    "certificates.hermite_1",
    "certificates.quintic_1",
    "certificates.degenerate",
    "certificates.hermite_road_1",
    "tunings.uniform_curved",
    "tunings.hermite_curved",
    "retimings.free",
    "routes.stopping",
)
"""Groups of which a few problems are repeated in every run; the marker `slow` selects all problems of all groups."""

OPTIMA = ("objectives", "durations")
"""Fields that are compared only if the stored search succeeded."""

SUBSET = 8
"""Number of problems of a group in every run."""


def same_statuses(found, before, given):
    changed = (found != before) & (before != UNDECIDED)
    assert not changed.any(), [(tuple(k), before[tuple(k)], found[tuple(k)]) for k in np.argwhere(changed)]


def same_codes(found, before, given):
    np.testing.assert_array_equal(found, before)


def codes_of_retimings(found, before, given):
    """The codes are as before, except that a speed at an end may be reached now."""
    reached = (before == qt.ResultCode.end_speed_not_reached) & (found == SUCCESSFUL)
    np.testing.assert_array_equal(np.where(reached, before, found), before)


def same_values(found, before, given):
    decided = given["statuses"] != UNDECIDED  # other values may be 0/0, that is, rounding errors
    known = decided & np.isfinite(before)  # NaN where a quantity is undefined, infinite at a pole
    np.testing.assert_array_equal(decided & np.isfinite(found), known)
    error = np.subtract(found, before, out=np.zeros(found.shape), where=known)
    error /= np.maximum(np.where(known, np.abs(before), 1.0), given["limits"])
    narrow = np.vectorize(lambda name: quantity(str(name)).divisor == "cross_norm")(given["names"])
    assert np.all((error >= -np.where(narrow, LOWER, VALUE)) & (error <= np.where(narrow, HIGHER, VALUE))), error


def as_good(relative, absolute=0.0):
    """Return a rule by which a number must not be larger than before."""

    def rule(found, before, given):
        assert np.all(found <= before + relative * np.abs(before) + absolute), np.max(found / before - 1)

    return rule


def as_fast(found, before, given):
    prescribed = np.any(given["speeds"] > 0, axis=1)
    as_good(DURATION)(found[~prescribed], before[~prescribed], given)
    as_good(WITH_SPEEDS)(found[prescribed], before[prescribed], given)


def close(relative):
    return lambda found, before, given: np.testing.assert_allclose(found, before, rtol=relative)


RULES = {
    "certificates": {"statuses": same_statuses, "values": same_values},
    "tunings": {"codes": same_codes, "objectives": as_good(OBJECTIVE, SMALL)},
    "retimings": {"codes": codes_of_retimings, "durations": as_fast, "statuses": same_statuses},
    "routes": {
        "codes": same_codes,
        "statuses": same_statuses,
        "segment_statuses": same_statuses,
        "values": same_values,
        "objectives": as_good(ROUTE_OBJECTIVE),
        "residuals": close(RESIDUAL),
        "fits": close(FIT),
    },
}
"""How the fields of an answer are compared, by the kind of the problems; other fields are not compared."""


def repeated(name, count=None):
    """Return the inputs, the stored answer and the present answer to `count` equally spaced problems of a group."""
    size = len(next(iter(STORED[name]["given"].values())))
    step = 1 if count is None else max(size // count, 1)
    given, before = ({key: x[::step] for key, x in STORED[name][part].items()} for part in ("given", "answer"))
    return given, before, GROUPS[name].answer(given)


def names_of(name):
    """Return the names of the limits of a group."""
    return (*GROUPS[name].names, "corridor")


def compare(name, record_property, count=None):
    given, before, found = repeated(name, count)
    known = given | {"statuses": before.get("statuses")}
    if "values" in before:
        known["names"] = np.broadcast_to(names_of(name)[: before["values"].shape[-1]], before["values"].shape)
    rules = RULES[name.split(".")[0]]
    for field, rule in rules.items():
        if field in before:
            # A search that failed has no optimum.
            compared = slice(None) if field not in OPTIMA else before["codes"] == SUCCESSFUL
            rule(
                found[field][compared],
                before[field][compared],
                {key: x[compared] for key, x in known.items() if x is not None},
            )
    if "statuses" in before:
        changes = np.argwhere((before["statuses"] == UNDECIDED) & (found["statuses"] != UNDECIDED))
        names = names_of(name)
        listed = [(int(k), names[j], STATUSES[found["statuses"][k, j]]) for k, j in changes]
        record_property(f"{name}: {len(changes)} limits were undecided at {COMMIT}", listed)
        if name.startswith("certificates."):
            require_right(name, given, found, changes)


def require_right(name, given, found, changes):
    """Check statuses that were undecided with 60 digits; `changes` contains the indices of problems and limits."""
    for k, j in changes:
        status, time = STATUSES[found["statuses"][k, j]], float(found["times"][k, j])
        wrong = contradiction(given, k, GROUPS[name].names[j], given["limits"][k, j], status, time)
        assert not wrong, (name, k, GROUPS[name].names[j], status, wrong)


def test_every_group_is_stored():
    assert STORED.keys() == GROUPS.keys()
    counts = dict.fromkeys(RULES, 0)
    for name, parts in STORED.items():
        counts[name.split(".")[0]] += len(next(iter(parts["given"].values())))
    assert counts["certificates"] >= 1000
    assert counts["tunings"] + counts["retimings"] + counts["routes"] >= 300


@pytest.mark.parametrize("name", QUICK)
def test_a_few_answers_are_as_before(name, record_property):
    compare(name, record_property, SUBSET)


@pytest.mark.slow
@pytest.mark.parametrize("name", GROUPS)
def test_all_answers_are_as_before(name, record_property):
    compare(name, record_property)
