"""Layer 3, attitude motion: profiles, programs, propagation, kinematics, control, dynamics."""
