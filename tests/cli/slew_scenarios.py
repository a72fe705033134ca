"""The scenario of a turn that the tests of `qtraj slew` vary: a quarter turn about z."""

REST = """
angles = "deg"
[start]
quaternion = [1, 0, 0, 0]
[end]
rotation_vector = [0, 0, 90]
"""
LAW = "[law]\nmax_rate = 1\nmax_acceleration = 0.05\n"
