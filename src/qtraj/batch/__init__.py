"""Layer 5: evaluation of many paths at many instants."""
