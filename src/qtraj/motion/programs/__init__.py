"""Attitude programs: what the attitude shall be at each instant."""
