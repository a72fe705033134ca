"""Layer 6: figures and reports."""
