"""Floor 3: how the vehicle must turn. Profiles, programs, propagation, kinematics, control, dynamics."""
