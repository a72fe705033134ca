"""Obstacles, the body that must stay clear of them, and the proofs that it does."""
