"""Benchmarks of speed (pytest) and of accuracy (`python -m benchmarks.accuracy`)."""

from . import bare as bare  # before qtraj
