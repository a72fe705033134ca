"""Express the inertia of a vehicle in the axes of a frame; the bank rolls the vehicle about the first axis."""

from typing import Any

PRODUCT_TOLERANCE = 64
"""Products of inertia up to this multiple of the machine epsilon times the sum of the moments count as zero."""


def inertia_in_frame(inertia: Any, cos: Any, sin: Any, xp: Any) -> Any:
    """Convert an inertia tensor (*batch, 3, 3) from the axes of the vehicle to the axes of the frame.

    `cos` and `sin` are the cosine and sine of the bank angle; a positive bank rolls the vehicle to the left. The arrays
    belong to the module `xp`, NumPy or JAX's NumPy. Without bank the result is exact.
    """
    xx, xy, xz, yy, yz, zz = (inertia[..., i, j] for i in range(3) for j in range(i, 3))
    mixed = 2 * (cos * (sin * yz))
    rolled_xy, rolled_xz = cos * xy + sin * xz, cos * xz - sin * xy
    rolled_yy, rolled_zz = cos * (cos * yy) + sin * (sin * zz) + mixed, cos * (cos * zz) + sin * (sin * yy) - mixed
    rolled_yz = cos * (cos * yz) - sin * (sin * yz) + cos * (sin * (zz - yy))
    rows = (xx, rolled_xy, rolled_xz), (rolled_xy, rolled_yy, rolled_yz), (rolled_xz, rolled_yz, rolled_zz)
    return xp.stack([xp.stack(xp.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def principal_moments(inertia: Any, xp: Any) -> tuple[Any, Any]:
    """Return the moments of inertia about the first and the third axis; NaN if these are not principal axes."""
    moments = inertia[..., 0, 0], inertia[..., 1, 1], inertia[..., 2, 2]
    products = (abs(inertia[..., i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    tolerance = PRODUCT_TOLERANCE * float(xp.finfo(inertia.dtype).eps) * (moments[0] + moments[1] + moments[2])
    principal = True
    for product in products:
        principal = principal & (product <= tolerance)
    return xp.where(principal, moments[0], xp.nan), xp.where(principal, moments[2], xp.nan)
