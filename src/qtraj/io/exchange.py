"""Convert attitudes to and from SciPy, jaxlie and plain arrays; function names state the order of components.

`wxyz` is qtraj's own order, scalar first; `xyzw` is the order of SciPy's default, ROS and many files. Quaternions are
arrays (..., 4) of any nonzero norm, body to inertial. SciPy and jaxlie also store R(λ), the rotation of the inertial
basis into the body basis; their `apply` maps body components to inertial components. Both are imported only on use.
"""

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.extras import require_package
from qtraj.foundation.types import ArrayInput

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = [
    "jaxlie_from_wxyz",
    "scipy_from_wxyz",
    "wxyz_from_jaxlie",
    "wxyz_from_scipy",
    "wxyz_from_xyzw",
    "xyzw_from_wxyz",
]


def __dir__() -> list[str]:
    return __all__


def xyzw_from_wxyz(wxyz: ArrayInput) -> Float[Array, "*n 4"]:
    """The same quaternions with the scalar part last."""
    return jnp.roll(_quaternions(wxyz), -1, axis=-1)


def wxyz_from_xyzw(xyzw: ArrayInput) -> Float[Array, "*n 4"]:
    """The same quaternions with the scalar part first."""
    return jnp.roll(_quaternions(xyzw), 1, axis=-1)


def scipy_from_wxyz(wxyz: ArrayInput) -> "Rotation":
    """SciPy's `Rotation` of quaternions (4,) or (n, 4); it keeps their signs but not their norms.

    **Raises:** ValueError for other shapes, and for a zero quaternion.
    """
    require_package("scipy", "an exchange with SciPy", None)
    from scipy.spatial.transform import Rotation

    values = np.asarray(_quaternions(wxyz), dtype=float)
    if values.ndim > 2:
        raise ValueError(f"SciPy accepts quaternions of shape (4,) or (n, 4), but got {values.shape}")
    return Rotation.from_quat(values, scalar_first=True)


def wxyz_from_scipy(rotation: "Rotation") -> np.ndarray:
    """The unit quaternions (4,) or (n, 4) of a SciPy `Rotation`, with its signs."""
    return rotation.as_quat(canonical=False, scalar_first=True)


def jaxlie_from_wxyz(wxyz: ArrayInput) -> Any:
    """jaxlie's `SO3` of quaternions (..., 4), normalised as jaxlie expects; NaN for a zero quaternion.

    The function can be traced and differentiated.
    """
    require_package("jaxlie", "an exchange with jaxlie", None)
    import jaxlie

    values = _quaternions(wxyz)
    largest = jnp.max(jnp.abs(values), axis=-1, keepdims=True)  # squares of small components must not underflow
    scaled = values / largest
    return jaxlie.SO3(wxyz=scaled / jnp.sqrt(jnp.sum(scaled * scaled, axis=-1, keepdims=True)))


def wxyz_from_jaxlie(rotation: Any) -> Float[Array, "*n 4"]:
    """The quaternions (..., 4) of a jaxlie `SO3`."""
    return rotation.wxyz


def _quaternions(values: ArrayInput) -> Array:
    quaternions = as_float(values)
    if quaternions.ndim == 0 or quaternions.shape[-1] != 4:
        raise ValueError(
            f"quaternions must have four components on the last axis, but got the shape {quaternions.shape}"
        )
    return quaternions
