"""Decide whether the speed, the curvature and the horizontal speed are zero, and so where frames and rates exist.

The functions accept numbers or triples of arrays, as in `frenet`.

The decisions depend on the present motion only. Its `span` [s] is how long the derivatives are of their present size:
on a polynomial path, the duration divided by the angle by which the path rotates in it; on a route, the duration of the
segment; on any other path, which may oscillate often, a thousandth of the duration.
"""

import functools
from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float

from qtraj.algebra.sparse import is_zero, mul
from qtraj.foundation.namespace import xp
from qtraj.path.frenet import Invariants

Numbers = Float[Array, "..."]
Flags = Bool[Array, "..."]

DEFINED_TOLERANCE = 4096
"""Tolerance in units of machine epsilon.

The curvature counts as zero if, at the current rate, the direction of r' would change by less than the tolerance [rad]
over the span, or if the angle between the lines of r' and r'' is less than the tolerance. The speed counts as zero if
it is less than the tolerance times the change of speed that r'' and r''' can cause over the time τ of `Regularity`. At
the tolerance, the principal normal is still accurate to three digits.
"""

SHORT = 1 / 1024
"""Square of the smallest fraction of the span after which r''' can have changed r'' noticeably."""


class Regularity(eqx.Module):
    """Dimensionless squares in [0, 1] that are 0 where a frame does not exist, at one instant or many.

    Let S = |r'|² and N = |r' × r''|², let H be the squared horizontal speed, let T be the span, and let τ be the time
    in which r''' changes r'' noticeably, T/32 ≤ τ ≤ T. Then `speed` is S/(S + τ²|r''|² + τ⁴|r'''|²), `cross_norm` is
    N/(S|r''|² + S²/T²), and `level` is H/S. Each ratio is 0 if its denominator is 0.
    """

    speed: Numbers
    cross_norm: Numbers
    level: Numbers


def regularity(i: Invariants, span: Numbers) -> Regularity:
    """Return the regularity of a path with invariants `i` and the `span` [s]."""
    speed_scale, cross_norm_scale = reference_squares(i, span)
    return Regularity(_ratio(i.S, speed_scale), _ratio(i.N, cross_norm_scale), _ratio(i.H, i.S))


def has_tangent(i: Invariants, span: Numbers) -> Flags:
    """Return whether a path with this `span` [s] has a tangent, that is, a nonzero speed."""
    return is_significant(i.S, reference_squares(i, span)[0])


def has_natural_frame(i: Invariants, span: Numbers) -> Flags:
    """Return whether the natural trihedral exists, that is, neither the speed nor the curvature is zero."""
    return has_tangent(i, span) & is_significant(i.N, reference_squares(i, span)[1])


def has_upright_frame(i: Invariants, span: Numbers) -> Flags:
    """Return whether the upright frame exists, that is, the velocity is neither zero nor vertical."""
    return has_tangent(i, span) & is_significant(i.H, i.S)


def has_road_frame(i: Invariants, span: Numbers) -> Flags:
    """Return whether the frame of the road of the vehicle exists; without a direction, it is the upright frame."""
    return has_upright_frame(i.on_road, span)


def rotating_span(duration: Numbers, rate: Any) -> Numbers:
    """Return the span [s] of a path of this `duration` [s] in a basis that rotates at `rate` [rad/s].

    The integer 0 stands for a rate that is always zero.
    """
    return duration if is_zero(rate) else duration / xp.sqrt(1 + (duration * rate) ** 2)


def reference_squares(i: Invariants, span: Array) -> tuple[Array, Array]:
    """Return the values to which S = |r'|² and N = |r' × r''|² are compared, to decide whether they are zero."""
    known = i.references
    if known is None or known[0] is not span:
        square = span**2
        changed = xp.maximum(i.A + square * i.J, float(xp.finfo(i.S.dtype).tiny))
        short = square * (i.A / changed + SHORT)  # τ²
        squares = i.S + short * i.A + short**2 * i.J, i.S * (i.A + i.S / square)
        i.references = known = (span, squares)
    return known[1]


def cross_norm_squares(i: Any, square: Any) -> tuple[Any, Any]:
    """Return N and the value to which it is compared, both times the `square` of the span, without a division."""
    return mul(square, i.N), i.S * (mul(square, i.A) + i.S)


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
