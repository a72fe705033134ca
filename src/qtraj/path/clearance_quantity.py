"""Define the clearance of a body from an obstacle, which only limits and certificates contain."""

from qtraj.path.path_quantity import PathQuantity

PREFIX = "keep_out["
"""The start of the names of limits on the clearance: keep_out[0] is that of the first obstacle."""

CLEARANCE = PathQuantity(
    "keep_out",
    "d",
    "m",
    0,
    "distance of the body from an obstacle; negative if the body enters the obstacle",
    numerator=lambda i: i.distance,
    base="keep_out",
    lower=True,
)
"""The entry of the clearance; obstacles compute its values and claims (see `qtraj.design.obstacles`)."""


def name_of_obstacle(k: int) -> str:
    """Return the name of the limit on the clearance from obstacle k, from 0."""
    return f"{PREFIX}{k}]"


def names_obstacle(name: str) -> bool:
    """Return whether a name is that of the limit on the clearance from an obstacle."""
    return name.startswith(PREFIX) and name.endswith("]") and name[len(PREFIX) : -1].isdigit()
