"""Objective functions for tuning."""
