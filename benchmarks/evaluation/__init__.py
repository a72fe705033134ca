"""Benchmark batched evaluation: a C kernel, NumPy with SciPy, and `qtraj.evaluate`, in one run."""
