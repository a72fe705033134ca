"""Suggest the correct name for an unknown name in the input."""

import difflib
from collections.abc import Sequence

LIKE = 0.7
"""Minimum similarity, from 0 to 1, of a suggested name; for example, it is 0.6 for 'duration' and 'acceleration'."""
SYNONYMS = {"velocity": ("speed", "rate")}
"""Words of other libraries, and the words for them in the names of this library."""


def suggestion(name: str, known: Sequence[str], what: str = "keys") -> str:
    """Return a suggestion for the unknown `name`, or the known names, which are of the kind `what`."""
    best = nearest(name, known)
    return f"did you mean '{best}'?" if best else f"the known {what} are {', '.join(known)}"


def nearest(name: str, known: Sequence[str]) -> str:
    """Return the known name that the user most probably meant, or '' if there is none."""
    begun = [key for key in known if name and key.startswith(name)]  # the user may have shortened the name
    if begun:
        return difflib.get_close_matches(name, begun, n=1, cutoff=0.0)[0]
    if contained := _contained([name], known):
        return contained
    near = difflib.get_close_matches(name, known, n=1, cutoff=LIKE)
    replaced = [name.replace(word, other) for word, others in SYNONYMS.items() if word in name for other in others]
    return near[0] if near else _contained(replaced, known)


def _contained(names: Sequence[str], known: Sequence[str]) -> str:
    """Return the longest known name whose words are part of one of the names, as 'jerk' is of 'max_jerk', or ''."""
    return max((key for name in names for key in known if f"_{key}_" in f"_{name}_"), key=len, default="")
