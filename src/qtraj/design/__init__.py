"""Layer 4: limits on a path, and boundary velocities that satisfy them."""
