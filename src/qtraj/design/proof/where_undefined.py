"""Describe the places where quantities are undefined, for the findings of certificates."""

from qtraj.path.path_quantity import FORCE, LOAD, ROAD_FRAME, UPRIGHT_FORCE, PathQuantity

WHERE_UNDEFINED = {
    "speed": "the speed is zero",
    "cross_norm": "the speed is zero or the path is straight",
    "level": "the speed is zero or the path is vertical; on a vertical loop the upright frame jumps by 180° there",
    ROAD_FRAME: "the speed is zero, the path is vertical (on a vertical loop, pass a vehicle with Road(left=...)), or "
    "the path runs along the direction to the left of such a road",
    LOAD: "the speed is zero, or the load on the road is not positive",
    FORCE: "the specific force is zero",
    UPRIGHT_FORCE: "the speed is zero, the path is vertical, or the specific force is zero or opposite to up",
}
"""Descriptions of the places where a divisor is zero, by divisor."""

OF_FUNCTION = "its function divides by zero or takes the root of a negative number"


def where_undefined(entry: PathQuantity) -> str:
    """Describe where a quantity is undefined."""
    if entry.own is not None and entry.own.guards:
        return OF_FUNCTION
    return WHERE_UNDEFINED[entry.divisor or "speed"]
