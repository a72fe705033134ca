"""Compute motion profiles Φ(t), of slews about a fixed axis or motions along a line, from limits or from a duration."""
