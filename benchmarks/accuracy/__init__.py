"""How accurate motion is: `python -m benchmarks.accuracy` in the root of the repository measures and prints the tables.

`--write` puts them between the markers of docs/accuracy.md and draws docs/figures; names limit it to these.
"""
