"""Functions that let compilers for CPUs combine many operations into a few fast loops; other devices are not slower.

`in_one_loop` and `derivatives_in_one_loop` are identities that merge loops. `inverse_root`, `root` and `cos_sin` use
only products and sums; `DIVISION` divides with them.
"""

from qtraj.batch.cpu.inverse_root import DIVISION, inverse_root, root
from qtraj.batch.cpu.one_loop import derivatives_in_one_loop, in_one_loop
from qtraj.batch.cpu.trigonometry import cos_sin

__all__ = ["DIVISION", "cos_sin", "derivatives_in_one_loop", "in_one_loop", "inverse_root", "root"]
