"""Motions of a tuned path: which velocities are variables, and the path that they define."""
