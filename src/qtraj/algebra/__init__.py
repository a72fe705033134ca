"""Layer 1: quaternions, rotations, polynomials."""

import lazy_loader

__getattr__, _, _ = lazy_loader.attach(__name__, ["dual_quaternion", "matrices", "quaternion", "rotation"])
