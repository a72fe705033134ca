"""Convert records to plain data for JSON: numbers, strings, lists and None."""

import math
from typing import Any

import numpy as np

from qtraj.foundation.record import Record


def plain(record: Record) -> dict[str, Any]:
    """Convert a record to a dict with its `summary`, all quantities by name, and their `units`.

    The quantities are numbers, strings or (nested) lists.

    Numbers that are not finite become None, because JSON has no NaN. Therefore
    `json.dumps(plain(result.record()))` works for every result.
    """
    everything = record.everything()
    values = {name: finite(np.asarray(quantity.values).tolist()) for name, quantity in everything.items()}
    units = {name: quantity.unit for name, quantity in everything.items() if quantity.unit}
    return {"summary": record.summary, **values, "units": units}


def tabular(record: Record) -> dict[str, Any]:
    """Return the `units` and the `columns` of a record over instants, with the names of the quantities as keys."""
    columns = plain(record)
    return {"units": columns.pop("units"), "columns": {name: columns[name] for name in record.everything()}}


def finite(value: Any) -> Any:
    """Replace NaN and infinities in `value`, also inside dicts and lists, by None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(v) for key, v in value.items()}
    return [finite(v) for v in value] if isinstance(value, list) else value
