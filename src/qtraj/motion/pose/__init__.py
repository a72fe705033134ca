"""Poses: programs for position and attitude, a law that controls both, and its simulation."""
