"""Layer 3: the motion of bodies: profiles, programs, propagation, simulation, control, poses, arms and dynamics."""
