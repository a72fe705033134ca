"""Quaternion matrices of paper S, whose entries are ± the components of a quaternion.

Each 4×4 matrix is Σ_k q_k E_k, where every E_k has exactly one entry ±1 in each row and column, and zeros elsewhere.
Let L(p) x = p∘x and R(p) x = x∘p, and let ᾱ be the conjugate of α:

| paper S | function | definition     | argument                       |
|---------|----------|----------------|--------------------------------|
| A       | `a`      | L(α)           | a quaternion (4,)              |
| Aᵗ      | `at`     | L(ᾱ)           | a quaternion (4,)              |
| ᵗA      | `ta`     | R(ᾱ)           | a quaternion (4,)              |
| ᵗAᵗ     | `tat`    | R(α)           | a quaternion (4,)              |
| Ṙ₀      | `r0`     | ᵗA of (0, r)   | a vector (3,)                  |
| Ṙ₀′     | `r0_prime` | Aᵗ of (0, r) | a vector (3,)                  |

ᵗA is A with its first row and first column exchanged. Identities: Aᵗ·ᵗAᵗ = |α|² diag(1, direction cosines), and ½(Ṙ₀ −
Ṙ₀′)(0, x) = (0, r × x). The square and the cube of ½(Ṙ₀ − Ṙ₀′) yield r × (r × x) and r × (r × (r × x)).

With the rate ω_X in body axes or ω_ξ in inertial axes, the kinematic equations are 2λ̇ = ᵗAᵗ(ω_X) λ = A(ω_ξ) λ
(Alpatov et al., 2021, doi 10.14738/tmlai.94.10523). Conversely, for a unit λ, (0, ω_X) = 2Aᵗλ̇ and (0, ω_ξ) = 2 ᵗA λ̇.
"""

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import cross as cross_product, dot, norm
from qtraj.foundation.namespace import matmul, namespace, of_arrays, xp
from qtraj.foundation.types import Mat4, Quat, Vec3

_UNIT_LEFT = [  # column m of E_k is e_k∘e_m, where e_0, …, e_3 are the units 1, i, j, k
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]],
    [[0, 0, -1, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, -1, 0, 0]],
    [[0, 0, 0, -1], [0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0]],
]
A_BASIS = np.array(_UNIT_LEFT, dtype=np.int8)
"""The four basis matrices of A; the first axis is the component of the quaternion."""
AT_BASIS = A_BASIS.transpose(0, 2, 1)
TAT_BASIS = A_BASIS.transpose(2, 1, 0)  # column m of E_k is e_m∘e_k
TA_BASIS = TAT_BASIS.transpose(0, 2, 1)


@of_arrays
def a(q: Quat) -> Mat4:
    """Return A = L(q), the matrix that maps x to q∘x."""
    return _combine(q, A_BASIS)


@of_arrays
def at(q: Quat) -> Mat4:
    """Return Aᵗ = L(q̄), the matrix that maps x to q̄∘x and the transpose of A; q̄ is the conjugate of q."""
    return _combine(q, AT_BASIS)


@of_arrays
def ta(q: Quat) -> Mat4:
    """Return ᵗA = R(q̄), the matrix that maps x to x∘q̄; it is A with its first row and first column exchanged."""
    return _combine(q, TA_BASIS)


@of_arrays
def tat(q: Quat) -> Mat4:
    """Return ᵗAᵗ = R(q), the matrix that maps x to x∘q and the transpose of ᵗA."""
    return _combine(q, TAT_BASIS)


@of_arrays
def r0(v: Vec3) -> Mat4:
    """Return the matrix Ṙ₀ of the vector v, which maps x to −x∘(0, v)."""
    return _combine(v, TA_BASIS[1:])


@of_arrays
def r0_prime(v: Vec3) -> Mat4:
    """Return the matrix Ṙ₀′ of the vector v, which maps x to −(0, v)∘x."""
    return _combine(v, AT_BASIS[1:])


@of_arrays
def cross(v: Vec3) -> Mat4:
    """Return ½(Ṙ₀ − Ṙ₀′), which maps (0, x) to (0, v × x)."""
    return 0.5 * (r0(v) - r0_prime(v))


@of_arrays
def cross_repeated(v: Vec3, x: Vec3, times: int = 1) -> Vec3:
    """Return v × (v × … (v × x)) with `times` products, as a power of ½(Ṙ₀ − Ṙ₀′) applied to (0, x)."""
    matrix, column = cross(v), xp.concatenate([xp.zeros_like(x[..., :1]), x], axis=-1)[..., None]
    for _ in range(times):
        column = matmul(matrix, column)
    return column[..., 1:, 0]


@of_arrays
def double_product(a: Vec3, b: Vec3, c: Vec3) -> Vec3:
    """Return a × (b × c) = b (a·c) − c (a·b), the first vector identity of paper S.

    Paper S writes it as a determinant with the columns (b, a·b) and (c, a·c).
    """
    return b * dot(a, c)[..., None] - c * dot(a, b)[..., None]


@of_arrays
def triple_product(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> Vec3:
    """Return a × [b × (c × d)] = (a × c)(b·d) − (a × d)(b·c), the second vector identity of paper S."""
    return cross_product(a, c) * dot(b, d)[..., None] - cross_product(a, d) * dot(b, c)[..., None]


@of_arrays
def rotation(q: Quat) -> Mat4:
    """Return Aᵗ·ᵗAᵗ = |λ|² diag(1, α) of λ = `q`, with the direction cosines α.

    For a unit λ, this matrix maps (0, v_ξ) to (0, v_X), the inertial to the body components of a vector.
    """
    return matmul(at(q), tat(q))


@of_arrays
def rotation_slope(q: Quat, q_dot: Quat) -> Mat4:
    """Return the time derivative of `rotation`, (Aᵗ)˙·ᵗAᵗ + Aᵗ·(ᵗAᵗ)˙.

    If |λ| = 1 at all times, the last three rows of the result are (0, τ̇), (0, ṅ) and (0, ḃ), with the body axes τ, n
    and b in inertial components.
    """
    first = matmul(at(q_dot), tat(q))
    return first + matmul(at(q), tat(q_dot))


@of_arrays
def kinematic(omega: Vec3, axes: str = "body") -> Mat4:
    """Return the matrix Ω of 2λ̇ = Ωλ for the rate `omega` (3,) [rad/s].

    Ω is ᵗAᵗ(ω_X) if `omega` is in body axes (ω_X), and A(ω_ξ) if it is in inertial axes (ω_ξ).

    **Raises:** ValueError if `axes` is neither 'body' nor 'inertial'.
    """
    _require_axes(axes)
    return _combine(omega, TAT_BASIS[1:] if axes == "body" else A_BASIS[1:])


@of_arrays
def rate(q: Quat, q_dot: Quat, axes: str = "body") -> Vec3:
    """Return the angular rate (3,) [rad/s] from λ = `q` and λ̇ = `q_dot` [1/s].

    It is the vector part of 2Aᵗλ̇/|λ|² in body axes, and of 2 ᵗA λ̇/|λ|² in inertial axes, with the matrix A of λ.

    **Raises:** ValueError if `axes` is neither 'body' nor 'inertial'.
    """
    _require_axes(axes)
    size = norm(q)[..., None]
    q = q / size  # |q|² could underflow or overflow
    matrix = at(q) if axes == "body" else ta(q)
    return 2 * matmul(matrix, (q_dot / size)[..., None])[..., 1:, 0]


def _require_axes(axes: str) -> None:
    if axes not in ("body", "inertial"):
        raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")


def _combine(components: Float[Array, " n"], basis: np.ndarray) -> Mat4:
    """Return Σ_k components[k]·basis[k]; there are no rounding errors, because each entry has only one nonzero term."""
    module = namespace(components)
    precision = {} if module is np else {"precision": "highest"}
    return module.einsum("...k,kij->...ij", components, basis.astype(components.dtype), **precision)
