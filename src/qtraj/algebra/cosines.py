"""Convert between quaternions λ and direction cosines α (inertial → body; the rows of α are the body axes)."""

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.algebra.quaternion import canonical, components, norm_squared, unit as unit_quaternion
from qtraj.algebra.vector import balanced, cross
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import is_host, matmul, namespace, of_arrays, xp
from qtraj.foundation.types import Mat3, Quat, Scalar

TOLERANCE = 1e-3
"""A matrix is a rotation if the elements of C Cᵀ − 1 and det C − 1 are at most this large; files round cosines."""

SIGNS = ((1, 1, 1, 1), (1, 1, -1, -1), (1, -1, 1, -1), (1, -1, -1, 1))
"""Paper S's matrix H, which maps the squared components of a unit quaternion to (1, α11, α22, α33).

α are the direction cosines. The matrix H/2 is its own inverse.
"""


@of_arrays
def to_dcm(q: Quat) -> Mat3:
    """Return the direction cosines α of the attitude `q`, which convert inertial to body components.

    `q` and `c*q` give the same result for any c ≠ 0.
    """
    q = balanced(q)
    s, x, y, z = components(q)
    rows = [
        [s * s + x * x - y * y - z * z, 2 * (x * y + s * z), 2 * (x * z - s * y)],
        [2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)],
        [2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z],
    ]
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2) / norm_squared(q)[..., None, None]


def from_dcm(C: Mat3) -> Quat:
    """Return the unit quaternion λ (..., 4) of the direction cosines `C` (..., 3, 3).

    The first non-zero component of λ is positive. Shepperd's method selects the row of the matrix 4 λ_i λ_k that
    contains the largest diagonal element. (The diagonal alone, as in `squares_from_dcm`, does not determine the signs
    of the components.) The value and the gradient are finite at every rotation. A traced matrix that is not a rotation
    to within 1e-3 has a quaternion of NaN. `nearest_dcm` returns the nearest rotation of any matrix.

    **Raises:** ValueError for a concrete matrix that is not a rotation to within 1e-3.
    """
    defect = rotation_defect(C)
    if not is_traced(defect):
        _require_rotations(np.asarray(C), np.asarray(defect))
        return from_rotation(C)
    return xp.where((defect <= TOLERANCE)[..., None], from_rotation(C), np.nan)


@of_arrays
def from_rotation(C: Mat3) -> Quat:
    """Return the same as `from_dcm` for direction cosines that are known to be a rotation, without a check."""
    return canonical(unit_quaternion(pivot_row(C)))


@of_arrays
def nearest_dcm(C: Mat3) -> Mat3:
    """Return the rotation with the smallest sum of squared differences from the elements of the matrix `C`.

    The result is R = U diag(1, 1, det U det V) Vᵀ from the singular value decomposition C = U S Vᵀ. It is unique, and
    differentiable, unless the smallest singular value is zero or, for a negative determinant, repeated. The derivatives
    are exact, also at a rotation, where those of the decomposition are not finite.
    """
    return _polar(C) if is_host(C) else _nearest(C)


@jax.custom_jvp
def _nearest(C: Mat3) -> Mat3:
    return _polar(C)


@_nearest.defjvp
def _turned(primals: tuple[Mat3], tangents: tuple[Mat3]) -> tuple[Mat3, Mat3]:
    """Return the nearest rotation R and its derivative R [ω]×.

    With the symmetric matrix P = RᵀC, (tr P − P) ω is the vector of the skew-symmetric matrix RᵀĊ − ĊᵀR.
    """
    R = _nearest(*primals)
    identity, transposed = jnp.broadcast_to(jnp.eye(3, dtype=R.dtype), R.shape), jnp.swapaxes(R, -1, -2)
    P, X = matmul(transposed, primals[0]), matmul(transposed, tangents[0])
    skew = X - jnp.swapaxes(X, -1, -2)
    vector = jnp.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    system = jnp.trace(P, axis1=-2, axis2=-1)[..., None, None] * identity - 0.5 * (P + jnp.swapaxes(P, -1, -2))
    omega = jnp.linalg.solve(system, vector[..., None])
    columns = [cross(omega[..., 0], identity[..., k]) for k in range(3)]
    return R, matmul(R, jnp.stack(columns, axis=-1))


def _polar(C: Mat3) -> Mat3:
    linalg = namespace(C).linalg
    u, _, v = linalg.svd(C)
    sign = xp.sign(linalg.det(u) * linalg.det(v))
    last = xp.stack([xp.ones_like(sign), xp.ones_like(sign), sign], axis=-1)
    return matmul(u * last[..., None, :], v)


@of_arrays
def rotation_defect(C: Mat3) -> Scalar:
    """Return the largest element of |C Cᵀ − 1| and |det C − 1|."""
    rows = [C[..., k, :] for k in range(3)]
    products = [[(a * b).sum(axis=-1) - float(i == j) for j, b in enumerate(rows)] for i, a in enumerate(rows)]
    volume = (cross(rows[0], rows[1]) * rows[2]).sum(axis=-1) - 1
    return xp.abs(xp.stack([volume, *(x for row in products for x in row)], axis=-1)).max(axis=-1)


def _require_rotations(C: np.ndarray, defect: np.ndarray) -> None:
    """Raise a ValueError for the first matrix that is not a rotation; NaN is passed on."""
    bad = np.argwhere(defect > TOLERANCE)
    if len(bad) == 0:
        return
    at = tuple(bad[0])
    where = f" (matrix {', '.join(map(str, at))} of the array)" if at else ""
    problem = "a reflection" if np.linalg.det(C[at]) < 0 else f"off a rotation by {defect[at]:.2g}"
    raise ValueError(
        f"direction cosines must be a rotation matrix, but {C[at].tolist()}{where} is {problem}: pass "
        "rotation.nearest_dcm(C) to use the nearest rotation"
    )


@of_arrays
def squares_from_dcm(C: Mat3) -> Quat:
    """Return the squared components of the unit quaternion of the direction cosines `C`.

    In paper S these are ¼H(1, α11, α22, α33), with the matrix H = `SIGNS` and the direction cosines α.
    """
    return 0.25 * xp.stack(_squares(C), axis=-1)


def pivot_row(C: Mat3) -> Quat:
    """Return 4 λ_k (λ0, λ1, λ2, λ3) for the k with the largest λ_k²; λ is the unit quaternion of the matrix `C`.

    The norm of the result is at least 2. Each component is selected separately, because the code that XLA generates for
    indexing an array of rows is slow for many matrices.
    """
    rows = _outer(C)
    a, b, c, d = (rows[k][k] for k in range(4))
    first, second, third = (a >= b) & (a >= c) & (a >= d), (b >= c) & (b >= d), c >= d
    choose = lambda w, x, y, z: xp.where(first, w, xp.where(second, x, xp.where(third, y, z)))  # noqa: E731
    return xp.stack([choose(*column) for column in zip(*rows, strict=True)], axis=-1)


def _outer(C: Mat3) -> list[list[Scalar]]:
    """Return the matrix with 4 λ_i λ_k in row i and column k; λ is the unit quaternion of the matrix `C`."""
    squares = _squares(C)
    d1, d2, d3 = C[..., 1, 2] - C[..., 2, 1], C[..., 2, 0] - C[..., 0, 2], C[..., 0, 1] - C[..., 1, 0]
    s1, s2, s3 = C[..., 1, 2] + C[..., 2, 1], C[..., 2, 0] + C[..., 0, 2], C[..., 0, 1] + C[..., 1, 0]
    return [
        [squares[0], d1, d2, d3],
        [d1, squares[1], s3, s2],
        [d2, s3, squares[2], s1],
        [d3, s2, s1, squares[3]],
    ]


def _squares(C: Mat3) -> list[Scalar]:
    return [1 + i * C[..., 0, 0] + j * C[..., 1, 1] + k * C[..., 2, 2] for _, i, j, k in SIGNS]
