"""Limits proved on the whole path."""
