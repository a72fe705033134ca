"""Scenarios that the tests of `qtraj slew` vary: a quarter turn about z, and one and a quarter turns about z."""

REST = """
angles = "deg"
[start]
quaternion = [1, 0, 0, 0]
[end]
rotation_vector = [0, 0, 90]
"""
ABOUT = """
angles = "deg"
axis = [0, 0, 2]
angle = 450
[start]
quaternion = [1, 0, 0, 0]
"""
LAW = "[law]\nmax_rate = 1\nmax_acceleration = 0.05\n"
