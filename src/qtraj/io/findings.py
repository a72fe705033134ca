"""The findings of certificates as variables of a dataset of paths."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from qtraj.design.proof.certificate import Certificate
from qtraj.foundation.record import variable_attributes
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.quantity import quantity

FINDING = "finding_"
"""The prefix of the variables with the status of a limit; their attribute `limit_name` is the name of the limit."""


def finding_variables(paths: list[str], certificates: Mapping[str, Certificate]) -> dict[str, Any]:
    """Return the largest value of each limited quantity on each path, its time, and the status of the limit."""
    variables: dict[str, Any] = {}
    for name in dict.fromkeys(name for certificate in certificates.values() for name in certificate.names):
        entry = quantity(name)
        extreme, finding, unit = *finding_names(name), entry.unit
        by_path = [certificates.get(path) for path in paths]
        with_limit = [c if c is not None and name in c.names else None for c in by_path]
        rows = [(np.nan, np.nan, "") if c is None else (*c.worst[name][:2], c.status[name]) for c in with_limit]
        times, values, texts = zip(*rows, strict=True)
        bounds = [np.nan if c is None else c.worst[name][2] for c in with_limit]
        limit = {"limit": float(next(c.worst[name][2] for c in with_limit if c is not None))}
        if len({x for x in bounds if x == x}) > 1:  # it changes along the way
            about_limit = variable_attributes(unit, f"limit there on the {entry.meaning}")
            variables[f"{extreme}_limit"] = (("path",), np.array(bounds, float), about_limit)
        about = f"of the {entry.meaning} on the whole path"
        variables[extreme] = (
            ("path",),
            np.array(values, float),
            variable_attributes(unit, f"{entry.extreme} value {about}") | limit,
        )
        variables[f"{extreme}_time"] = (
            ("path",),
            np.array(times, float),
            variable_attributes("s", f"time of the {entry.extreme} value {about}"),
        )
        variables[finding] = (
            ("path",),
            np.array(texts, str),
            {"long_name": f"status of the limit {about}", "limit_name": str(name)},
        )
    return variables


def finding_names(name: str) -> tuple[str, str]:
    """Return the names of the variables with the worst value of a limited quantity and with the status of its limit."""
    entry = quantity(name)
    if names_obstacle(name):  # keep_out[0] becomes keep_out_0
        variable = name.replace("[", "_").replace("]", "")
        return f"{entry.extreme}_{variable}", f"{FINDING}{variable}"
    extreme = f"{entry.extreme}_{entry.variable}"
    return extreme, f"{FINDING}{extreme if entry.lower else entry.variable}"
