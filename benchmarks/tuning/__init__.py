"""Compare tuning with general optimisers on the same problems, in one run."""
