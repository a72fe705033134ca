"""Tuning of boundary velocities, so that a path satisfies limits."""
