"""Objectives of a tuning, which the solution minimises."""
