"""Measure the accuracy of the motion layer.

Run `python -m benchmarks.accuracy` in the root of the repository to measure and print the tables.
`--write` also inserts the tables between the markers in docs/accuracy.md and draws the figures in docs/figures. To
select tables and figures, pass their names.
"""
