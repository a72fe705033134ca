"""Boundary velocities that meet limits."""
