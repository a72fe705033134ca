"""Layer 3: the motion of bodies: profiles, programs, propagation, simulation, control, poses, arms and torques."""

import lazy_loader

__getattr__, _, _ = lazy_loader.attach(__name__, ["control", "dynamics", "torques"])
