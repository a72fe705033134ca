"""Tuning against general optimisers: the same problems, the same derivatives, one run."""
