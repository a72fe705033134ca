"""Select the columns of a shape: its position, and its widths to the right and to the left edge."""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from qtraj.io.track.column_names import find
from qtraj.io.track.known_names import COMMON, FLAT, GLOBAL, HEIGHTS, MORE
from qtraj.io.track.missing_columns import first_values, listed

UPWARDS = sorted(HEIGHTS - {"down", "d", "depth"})
SPATIAL = (*COMMON["position"], *MORE["position"], *map(",".join, itertools.product(FLAT, UPWARDS)))
"""Names of positions in metres with a height."""

WIDTHS = (
    "w_tr_right,w_tr_left",
    "width_right,width_left",
    "right_width,left_width",
    "w_right,w_left",
    "width_to_right,width_to_left",
)
"""Names of the distances to the right and to the left edge; the first pair is that of race tracks of the TU Munich."""

COUNTS = {"position": (2, 3), "widths": (2,)}


def choose(
    path: Path | str, header: list[str], first: Sequence[str], given: Mapping[str, Any], own: Any, globe: bool
) -> dict[str, tuple[str, ...]]:
    """Return the names of the columns of the position and, if there are any, of the widths.

    `given` are the names of the user, `own` the columns of the position that the format defines, or None, and `globe`
    indicates whether the position is geographic.

    **Raises:** ValueError for an unknown key, a wrong number of columns, and columns that do not exist.
    """
    if unknown := sorted(set(given) - set(COUNTS)):
        raise ValueError(f"columns= of a shape accepts the keys position and widths, but {unknown[0]!r} was given")
    places = GLOBAL if globe else (*SPATIAL, *FLAT, *GLOBAL)
    found = {"position": own or find(places, header), "widths": find(WIDTHS, header)}
    chosen: dict[str, tuple[str, ...]] = {}
    for part, names in (found | dict(given)).items():
        if not names:
            continue
        names = (names,) if isinstance(names, str) else tuple(names)
        if len(names) not in COUNTS[part]:
            wanted = "2 or 3 columns" if part == "position" else "2 columns, to the right and to the left"
            raise ValueError(f"columns[{part!r}] must name {wanted}, but {list(names)!r} was given")
        if absent := [name for name in names if name not in header]:
            raise ValueError(f"{path}: there is no column {absent[0]!r}: the columns are {listed(header)}")
        chosen[part] = names
    if "position" not in chosen:
        raise ValueError(
            f"{path}: no columns for the position were found. The columns are {listed(header)}; name two or three with "
            'columns={"position": ["...", "..."]}, on the command line with --columns position=a,b.'
            + first_values(header, first)
        )
    return chosen
