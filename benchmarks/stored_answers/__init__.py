"""Random problems and the answers of qtraj at one commit, which `tests/design/test_stored_answers.py` repeats.

`python -m benchmarks.stored_answers` creates the problems and stores them with the answers of the qtraj that is
imported. A group consists of problems with the same kind of path and the same limits, so that they share compiled code.
"""

from pathlib import Path

import numpy as np

from . import certificates, retimings, routes, tunings

FILE = Path(__file__).parents[2] / "tests" / "data" / "answers.npz"

GROUPS = {
    f"{kind}.{name}": group
    for kind, groups in {
        "certificates": certificates.GROUPS,
        "tunings": tunings.GROUPS,
        "retimings": retimings.GROUPS,
        "routes": routes.GROUPS,
    }.items()
    for name, group in groups.items()
}
"""All groups by name; the first part of a name is the kind of the problems."""


def stored(file=FILE):
    """Return the commit that computed the answers, and the fields of each group: `given` and `answer`, by name."""
    with np.load(file, allow_pickle=False) as archive:
        arrays = dict(archive)
    groups = {}
    for key, values in arrays.items():
        if key != "commit":
            kind, name, part, field = key.split(".")
            groups.setdefault(f"{kind}.{name}", {"given": {}, "answer": {}})[part][field] = values
    return str(arrays["commit"]), groups
