"""Define array types with their shapes.

The last axis contains components. Core functions accept one instant; use `jax.vmap` for several instants. The types are
named aliases, so that `help` and signatures show their names.
"""

from collections.abc import Sequence
from typing import Any

from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Real
from typing_extensions import TypeAliasType

Scalar = TypeAliasType("Scalar", Float[Array, ""])
Flag = TypeAliasType("Flag", Bool[Array, ""])
Vec3 = TypeAliasType("Vec3", Float[Array, "3"])
Quat = TypeAliasType("Quat", Float[Array, "4"])
DualQuat = TypeAliasType("DualQuat", Float[Array, "8"])
Mat3 = TypeAliasType("Mat3", Float[Array, "3 3"])
Mat4 = TypeAliasType("Mat4", Float[Array, "4 4"])
Mat6 = TypeAliasType("Mat6", Float[Array, "6 6"])

ScalarLike = TypeAliasType("ScalarLike", Real[ArrayLike, ""])

ArrayInput = TypeAliasType("ArrayInput", ArrayLike | Sequence[Any])
"""Input of constructors: JAX arrays, NumPy arrays, numbers, or (nested) lists of numbers."""
