"""Layer 4: limits on paths, proofs, tuning, timing, and fits to recordings."""
