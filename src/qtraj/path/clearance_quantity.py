"""Define the clearance of a body from an obstacle, which only limits and certificates contain."""

import re

from qtraj.path.path_quantity import PathQuantity

NAME = re.compile(r"keep_out\[\d+\](\[\d+\])?")
"""The names of limits on the clearance: keep_out[0] is that of the first obstacle, and keep_out[0][2] that of the third
ball of the body from it, which only searches use."""

CLEARANCE = PathQuantity(
    "keep_out",
    "d",
    "m",
    1,
    "distance of the body from an obstacle; negative if the body enters the obstacle",
    numerator=lambda i: i.distance,
    base="keep_out",
    lower=True,
)
"""The entry of the clearance; obstacles compute its values and claims (see `qtraj.design.obstacles`)."""


def name_of_obstacle(k: int) -> str:
    """Return the name of the limit on the clearance from obstacle k, from 0."""
    return f"keep_out[{k}]"


def names_obstacle(name: str) -> bool:
    """Return whether a name is that of the limit on the clearance from an obstacle."""
    return NAME.fullmatch(name) is not None
