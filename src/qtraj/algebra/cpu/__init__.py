"""Functions that let CPU compilers combine many operations into a few fast loops; other devices are not slowed down.

`in_one_loop` and `derivatives_in_one_loop` are identities that merge loops. `inverse_root`, `root` and `cos_sin` use no
root, no division and no library function.
"""

from qtraj.algebra.cpu.inverse_root import inverse_root, root
from qtraj.algebra.cpu.one_loop import derivatives_in_one_loop, in_one_loop
from qtraj.algebra.cpu.trigonometry import cos_sin

__all__ = ["cos_sin", "derivatives_in_one_loop", "in_one_loop", "inverse_root", "root"]
