"""Floor 5: many paths at many instants."""
