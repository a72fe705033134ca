"""Objectives of a tuning: what is least at the solution."""
