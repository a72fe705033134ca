"""Layer 2: hodographs (position curves), their invariants and trihedra, and recorded tracks."""
