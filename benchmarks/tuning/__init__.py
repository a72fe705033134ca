"""Tuning compared with general optimisers: the same problems, the same derivatives, one run."""
