"""Motions of a tuned path; a motion determines the variables, and how the angle depends on time."""
