"""Parts of scenarios of `qtraj simulate`, shared by tests."""

SLEW = """
angles = "deg"
[program.slew.start]
quaternion = [1, 0, 0, 0]
[program.slew.end]
rotation_vector = [0, 0, 30]
[program.slew.law]
max_acceleration = 20
"""
LAW = "[law]\nsettling_time = 3\n"
