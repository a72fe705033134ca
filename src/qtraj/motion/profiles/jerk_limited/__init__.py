"""Compute the fastest motions between states of angle, rate and acceleration, with a limited jerk."""
