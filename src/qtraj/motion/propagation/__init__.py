"""Propagation: λ(t) from a known rate ω(t)."""
