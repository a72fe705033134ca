"""Serial manipulators: where the gripper is, how it moves with the joints, and joint accelerations from a law."""
