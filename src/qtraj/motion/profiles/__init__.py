"""Laws of turning about a fixed axis: Φ(t) from limits or from a duration."""
