"""Propagate λ(t) for a prescribed angular rate ω(t)."""
