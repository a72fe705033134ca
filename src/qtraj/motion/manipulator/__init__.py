"""Serial manipulators: kinematics of the gripper, inverse kinematics of accelerations, and simulation under a law."""
