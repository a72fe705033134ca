"""What compilers for CPUs need to make few fast loops of much arithmetic; other devices lose nothing by it.

`in_one_loop` and `derivatives_in_one_loop` are identities; `inverse_root`, `root` and `cos_sin` are what they say, of
products and sums alone; `DIVISION` divides by them.
"""

from qtraj.batch.cpu.inverse_root import DIVISION, inverse_root, root
from qtraj.batch.cpu.one_loop import derivatives_in_one_loop, in_one_loop
from qtraj.batch.cpu.trigonometry import cos_sin

__all__ = ["DIVISION", "cos_sin", "derivatives_in_one_loop", "in_one_loop", "inverse_root", "root"]
