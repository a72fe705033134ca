"""Position and attitude together along a path: programs of poses, a law for both, and their simulation."""
