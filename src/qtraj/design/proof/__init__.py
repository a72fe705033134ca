"""Proofs that limits are satisfied on the whole path."""
