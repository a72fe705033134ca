"""Benchmarks of speed (pytest) and of accuracy (`python -m benchmarks.accuracy`)."""
