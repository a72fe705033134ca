"""Attitude programs: the reference attitude as a function of time."""
