"""Layer 2: where the vehicle must be. Hodographs, their invariants and trihedra, recorded tracks."""
