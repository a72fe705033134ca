"""Suggest the correct name for an unknown name in the input."""

import difflib
from collections.abc import Sequence

LIKE = 0.7
"""Minimum similarity, from 0 to 1, of a suggested name; for example, it is 0.6 for 'duration' and 'acceleration'."""


def suggestion(name: str, known: Sequence[str], what: str = "keys") -> str:
    """Return a suggestion for the unknown `name`, or the known names, which are of the kind `what`."""
    begun = [key for key in known if key.startswith(name)]  # the user may have shortened the name
    near = difflib.get_close_matches(name, begun or known, n=1, cutoff=0.0 if begun else LIKE)
    return f"did you mean '{near[0]}'?" if near else f"the known {what} are {', '.join(known)}"
