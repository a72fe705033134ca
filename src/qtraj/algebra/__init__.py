"""Layer 1: quaternions, rotations, polynomials."""
