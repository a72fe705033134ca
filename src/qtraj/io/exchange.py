"""Convert attitudes to and from SciPy, jaxlie and plain arrays; function names contain the order of components.

`wxyz` is the order of qtraj, scalar first; `xyzw` is the default order of SciPy, and the order of ROS and many files.
Quaternions are arrays (..., 4) of any nonzero norm, body to inertial. SciPy and jaxlie represent the same rotation
R(λ) as qtraj: it rotates the inertial basis into the body basis, and `apply` maps body components to inertial ones.
Both packages are imported only when used.
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
    """Reorder quaternions so that the scalar part is last."""
    return jnp.roll(_quaternions(wxyz), -1, axis=-1)


def wxyz_from_xyzw(xyzw: ArrayInput) -> Float[Array, "*n 4"]:
    """Reorder quaternions so that the scalar part is first."""
    return jnp.roll(_quaternions(xyzw), 1, axis=-1)


def scipy_from_wxyz(wxyz: ArrayInput) -> "Rotation":
    """Convert quaternions (4,) or (n, 4) to a SciPy `Rotation`, which normalises them but keeps their signs.

    **Raises:** ValueError for any other shape, and for a zero quaternion.
    """
    require_package("scipy", "conversion to SciPy's Rotation", None)
    from scipy.spatial.transform import Rotation

    values = np.asarray(_quaternions(wxyz), dtype=float)
    if values.ndim > 2:
        raise ValueError(f"SciPy accepts quaternions of shape (4,) or (n, 4), but shape {values.shape} was given")
    return Rotation.from_quat(values, scalar_first=True)


def wxyz_from_scipy(rotation: "Rotation") -> np.ndarray:
    """Convert a SciPy `Rotation` to unit quaternions (4,) or (n, 4), with the signs that `rotation` stores."""
    return rotation.as_quat(canonical=False, scalar_first=True)


def jaxlie_from_wxyz(wxyz: ArrayInput) -> Any:
    """Normalise quaternions (..., 4), as jaxlie expects, and convert them to a jaxlie `SO3`.

    The result is NaN for a zero quaternion. The function can be traced and differentiated.
    """
    require_package("jaxlie", "conversion to jaxlie's SO3", None)
    import jaxlie

    values = _quaternions(wxyz)
    largest = jnp.max(jnp.abs(values), axis=-1, keepdims=True)  # prevents underflow of the squares of small components
    scaled = values / largest
    return jaxlie.SO3(wxyz=scaled / jnp.sqrt(jnp.sum(scaled * scaled, axis=-1, keepdims=True)))


def wxyz_from_jaxlie(rotation: Any) -> Float[Array, "*n 4"]:
    """Convert a jaxlie `SO3` to quaternions (..., 4)."""
    return rotation.wxyz


def _quaternions(values: ArrayInput) -> Array:
    quaternions = as_float(values)
    if quaternions.ndim == 0 or quaternions.shape[-1] != 4:
        raise ValueError(
            f"quaternions must have four components on the last axis, but shape {quaternions.shape} was given"
        )
    return quaternions
