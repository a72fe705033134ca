"""Floor 4: limits on a path, and the boundary velocities that meet them."""
