"""Layer 5: many variants of one problem, and what they have in common."""
