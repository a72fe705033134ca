"""Shapes in types. Components stand on the last axis; core functions take one instant and are vmapped."""

from collections.abc import Sequence
from typing import Any

from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Real

Scalar = Float[Array, ""]
Flag = Bool[Array, ""]
Vec3 = Float[Array, "3"]
Quat = Float[Array, "4"]
Mat3 = Float[Array, "3 3"]
Mat4 = Float[Array, "4 4"]

ScalarLike = Real[ArrayLike, ""]

ArrayInput = ArrayLike | Sequence[Any]
"""What constructors take from a user: arrays of JAX or NumPy, numbers, and (nested) lists of numbers."""
