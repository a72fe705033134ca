"""Poses: programs of position and attitude, a law for both, and their simulation."""
