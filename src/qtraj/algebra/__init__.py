"""Floor 1: quaternions, rotations, polynomials."""
