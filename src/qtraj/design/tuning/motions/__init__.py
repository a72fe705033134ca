"""Motions of a tuned path: what may move, and the path it makes."""
