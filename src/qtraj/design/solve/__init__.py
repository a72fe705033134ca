"""Solve problems with many small groups of variables, such as routes and timings, by interior-point methods."""
