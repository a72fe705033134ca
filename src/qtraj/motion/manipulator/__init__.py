"""Serial manipulators: kinematics of the gripper, inverse kinematics of accelerations, and closed-loop simulation."""
