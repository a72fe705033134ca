"""Decide whether the speed, the curvature and the horizontal speed are zero, and so where frames and rates exist.

The functions accept numbers or triples of arrays, as in `frenet`.
"""

import functools
from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float

from qtraj.algebra.sparse import mul
from qtraj.foundation.namespace import xp
from qtraj.path.frenet import Invariants

Numbers = Float[Array, "..."]
Flags = Bool[Array, "..."]

DEFINED_TOLERANCE = 4096
"""Tolerance in units of machine epsilon.

The curvature counts as zero if, at the current rate, the direction of r' would change by less than the tolerance [rad]
over the duration, or if the angle between the lines of r' and r'' is less than the tolerance. The speed counts as zero
if it is less than the tolerance times the change of speed that r'' and r''' can cause over the duration. At the
tolerance, the principal normal is still accurate to three digits.
"""


class Regularity(eqx.Module):
    """Dimensionless squares in [0, 1] that are 0 where a frame does not exist, at one instant or many.

    Let S = |r'|² and N = |r' × r''|², let H be the squared horizontal speed, and let T be the duration. Then `speed` is
    S/(S + T²|r''|² + T⁴|r'''|²), `cross_norm` is N/(S|r''|² + S²/T²), and `level` is H/S. Each ratio is 0 if its
    denominator is 0.
    """

    speed: Numbers
    cross_norm: Numbers
    level: Numbers


def regularity(i: Invariants, duration: Numbers) -> Regularity:
    """Return the regularity of a path with invariants `i` and the `duration` [s]."""
    speed_scale, cross_norm_scale = reference_squares(i, duration)
    return Regularity(_ratio(i.S, speed_scale), _ratio(i.N, cross_norm_scale), _ratio(i.H, i.S))


def has_tangent(i: Invariants, duration: Numbers) -> Flags:
    """Return whether a path with this `duration` [s] has a tangent, that is, a nonzero speed."""
    return is_significant(i.S, reference_squares(i, duration)[0])


def has_natural_frame(i: Invariants, duration: Numbers) -> Flags:
    """Return whether the natural trihedral exists, that is, neither the speed nor the curvature is zero."""
    return has_tangent(i, duration) & is_significant(i.N, reference_squares(i, duration)[1])


def has_upright_frame(i: Invariants, duration: Numbers) -> Flags:
    """Return whether the upright frame exists, that is, the velocity is neither zero nor vertical."""
    return has_tangent(i, duration) & is_significant(i.H, i.S)


def reference_squares(i: Invariants, duration: Array) -> tuple[Array, Array]:
    """Return the values to which S = |r'|² and N = |r' × r''|² are compared, to decide whether they are zero."""
    known = i.references
    if known is None or known[0] is not duration:
        span = duration**2
        squares = i.S + span * i.A + span**2 * i.J, cross_norm_reference(i, span)
        i.references = known = (duration, squares)
    return known[1]


def cross_norm_reference(i: Invariants, span: Any) -> Any:
    """Return the value to which N = |r' × r''|² is compared, for the square of the duration."""
    return i.S * (i.A + i.S / span)


def cross_norm_squares(i: Any, span: Any) -> tuple[Any, Any]:
    """Return N and the value to which it is compared, both times the square of the duration, without a division."""
    return mul(span, i.N), i.S * (mul(span, i.A) + i.S)


def is_significant(square: Any, reference: Any) -> Flags:
    """Return whether `square` exceeds both `reference` times the squared tolerance and the smallest normal number."""
    tolerance, tiny = _limits(square.dtype)
    return xp.maximum(reference * tolerance, tiny) < square


@functools.cache
def _limits(dtype: Any) -> tuple[float, float]:
    """Return the squared tolerance, and the smallest normal number."""
    limits = xp.finfo(dtype)
    return (DEFINED_TOLERANCE * float(limits.eps)) ** 2, float(limits.tiny)


def _ratio(square: Any, reference: Any) -> Any:
    positive = reference > 0
    return xp.where(positive, square / xp.where(positive, reference, 1.0), 0.0)
