"""Claims that a ball is on the free side of a plane."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from qtraj.algebra.combined_claims import AnyClaim, all_of, any_of
from qtraj.algebra.surd import Claim
from qtraj.design.obstacles.place import Place, number


def beyond_wall(height: Any, normal_sq: Any, reach: Fraction, place: Place) -> AnyClaim:
    """Return the claim that the centre is at least `reach` [m] from a plane.

    `height` is the distance of the centre times the length of the normal and the weight of `place`. The length of the
    normal may be irrational, so that squares are compared.
    """
    above = Claim(height)
    if not reach:
        return above
    least = number(reach * reach) * normal_sq * place.weight_sq
    if reach > 0:
        return all_of([above, Claim(height * height - least)])
    return any_of([above, Claim(least - height * height)])
