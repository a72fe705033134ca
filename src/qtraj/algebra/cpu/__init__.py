"""Functions that let compilers for CPUs combine much arithmetic into few fast loops; other devices are not slower.

`in_one_loop` and `derivatives_in_one_loop` are identities that merge loops. `inverse_root`, `root` and `cos_sin` use
only products and sums.
"""

from qtraj.algebra.cpu.inverse_root import inverse_root, root
from qtraj.algebra.cpu.one_loop import derivatives_in_one_loop, in_one_loop
from qtraj.algebra.cpu.trigonometry import cos_sin

__all__ = ["cos_sin", "derivatives_in_one_loop", "in_one_loop", "inverse_root", "root"]
