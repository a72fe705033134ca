"""Compute motion profiles Φ(t) of slews about a fixed axis, from limits or from a duration."""
