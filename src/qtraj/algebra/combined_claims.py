"""Claims that consist of other claims, of which all or at least one must hold at each point."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, Protocol

from qtraj.algebra.signs import Signs


class AnyClaim(Protocol):
    """The claim that a function is nonnegative; the signs of its `polynomials` determine the sign of the function."""

    polynomials: list[Any]

    def sign(self, signs: Sequence[Signs]) -> Signs:
        """Return the signs of the function from the signs of its polynomials."""
        ...


class _Combined:
    """Several claims; the function is the largest or the smallest one of their functions."""

    def __init__(self, claims: Sequence[AnyClaim], largest: bool):
        self.polynomials = [p for claim in claims for p in claim.polynomials]
        self._claims, self._largest = claims, largest

    def sign(self, signs: Sequence[Signs]) -> Signs:
        """Return the signs of the largest or of the smallest function."""
        own = _split(self._claims, signs)
        some, every = ("ge", "gt"), ("le", "lt")
        some, every = (some, every) if self._largest else (every, some)
        found = {name: _joined(own, name, False) for name in some} | {name: _joined(own, name, True) for name in every}
        return Signs(**found)

    def reduced(self, signs: Sequence[Signs]) -> tuple[AnyClaim, list[bool]]:
        """Return the claim without the parts that `signs` decide, and which polynomials it still has.

        A part that is negative cannot be the largest one, and one that is positive cannot make the smallest one
        negative. At least one part remains.
        """
        parts, kept = [], []
        for claim, own, sign in zip(self._claims, _own(self._claims, signs), _split(self._claims, signs), strict=True):
            if sign.lt if self._largest else sign.gt:
                kept += [False] * len(own)
                continue
            part, of_part = reduced(claim, own)
            parts.append(part)
            kept += of_part
        if not parts or all(kept):
            return self, [True] * len(self.polynomials)
        return _Combined(parts, self._largest) if len(parts) > 1 else parts[0], kept


def reduced(claim: AnyClaim, signs: Sequence[Signs]) -> tuple[AnyClaim, list[bool]]:
    """Return a claim that is the same as `claim` where its polynomials have these signs, and which of them it has."""
    return claim.reduced(signs) if isinstance(claim, _Combined) else (claim, [True] * len(claim.polynomials))


class Except:
    """The claim that something holds, except where one of several functions is positive; it must hold where all are 0.

    This is stricter than `any_of`, with which nothing would be claimed where one of the functions is zero.
    """

    def __init__(self, claim: AnyClaim, elsewhere: Sequence[AnyClaim]):
        self.polynomials = [p for x in (claim, *elsewhere) for p in x.polynomials]
        self._claims = claim, *elsewhere

    def sign(self, signs: Sequence[Signs]) -> Signs:
        """Return the signs of the claim; where a function is positive, the claim counts as positive, too."""
        own, *others = _split(self._claims, signs)
        for x in others:
            own = Signs(ge=own.ge | x.gt, le=own.le & x.le, gt=own.gt | x.gt, lt=own.lt & x.le)
        return own


def all_of(claims: Sequence[AnyClaim]) -> AnyClaim:
    """Return the claim that all claims hold at each point."""
    return claims[0] if len(claims) == 1 else _Combined(claims, largest=False)


def any_of(claims: Sequence[AnyClaim]) -> AnyClaim:
    """Return the claim that at each point at least one of the claims holds."""
    return claims[0] if len(claims) == 1 else _Combined(claims, largest=True)


def _joined(signs: list[Signs], name: str, every: bool) -> Any:
    result = getattr(signs[0], name)
    for x in signs[1:]:
        result = result & getattr(x, name) if every else result | getattr(x, name)
    return result


def _split(claims: Sequence[AnyClaim], signs: Sequence[Signs]) -> list[Signs]:
    """Return the signs of each claim from those of the polynomials of all claims."""
    return [claim.sign(own) for claim, own in zip(claims, _own(claims, signs), strict=True)]


def _own(claims: Sequence[AnyClaim], signs: Sequence[Signs]) -> list[Sequence[Signs]]:
    """Return the signs of the polynomials of each claim."""
    ends = [*accumulate(len(claim.polynomials) for claim in claims)]
    return [signs[start:end] for start, end in zip([0, *ends], ends, strict=False)]
