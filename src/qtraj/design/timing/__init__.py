"""Compute the fastest timing along a given path, with proofs that the limits are satisfied between samples, too."""
