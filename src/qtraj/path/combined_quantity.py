"""Define the combined acceleration relative to an ellipse, which only a limit contains."""

from qtraj.path.path_quantity import PathQuantity

COMBINED = "combined_acceleration"
"""The name of the combined acceleration relative to an ellipse; the limit itself contains the ellipse."""

COMBINED_QUANTITY = PathQuantity(
    COMBINED,
    "a/a_max",
    "1",
    2,
    "longitudinal and lateral acceleration relative to an ellipse; 1 on the ellipse",
    numerator=lambda i: i.A,
    denominator=lambda i: i.S,
    divisor="speed",
    bounds_speed=True,
)
"""The entry of limits on the combined acceleration; formulas with the ellipse compute its values and claims."""
