"""Tune boundary velocities so that a path satisfies limits."""
