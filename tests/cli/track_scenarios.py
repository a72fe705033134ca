"""Texts that the scenarios of the tests of `qtraj track` are made of."""

TURN = """
angles = "deg"
[program.turn.start]
quaternion = [1, 0, 0, 0]
[program.turn.end]
rotation_vector = [0, 0, 30]
[program.turn.law]
max_acceleration = 20
"""
LAW = "[law]\nsettling_time = 3\n"
