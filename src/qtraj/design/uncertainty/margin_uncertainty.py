"""How certainly a fitted path satisfies limits: margins with standard deviations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from qtraj.design.along import Along
from qtraj.design.ellipse import OfSpeed
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limit_checks import refuse_changing
from qtraj.design.limits import Limits, require_limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.uncertainty.propagation import propagate
from qtraj.design.uncertainty.uncertainty import instants, require_fit
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.drawing import draw
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, times_text
from qtraj.foundation.types import ArrayInput
from qtraj.path.distances import distances
from qtraj.path.quantity import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIRST_ORDER = "These probabilities are of first order in the errors of the fit: the nonlinearity is not included."

NONLINEAR = 0.3
"""Largest nonlinearity with which a distribution is almost normal."""

MANY = 100.0
"""Scores above this are not printed as numbers: they may be infinite, where an error does not change a quantity."""

SAMPLES, PER_SEGMENT = 513, 8
"""Default number of instants: at least this, and this number for each segment of a route."""


class Closest(NamedTuple):
    """The instant at which a margin is smallest in units of its standard deviation.

    `time` [s]; `margin` and `sigma` in the unit of the quantity; `score` is margin/sigma, negative where the limit is
    violated; `probability` that the limit is satisfied at this instant. All are NaN if no margin is known.
    """

    time: float
    margin: float
    sigma: float
    score: float
    probability: float


UNKNOWN = Closest(math.nan, math.nan, math.nan, math.nan, math.nan)


class MarginUncertainty(AbstractResult):
    """The margins of limits along a fitted path at n instants, with their standard deviations.

    - `time` (n,) [s], from the start of the path.
    - `margin`: the distances from the limits by name, (n,), as in `Limits.margins`; negative where violated.
    - `sigma` and `nonlinearity`, by name, (n,), as in `Uncertainty`. NaN where unknown.
    """

    time: Float[Array, " n"]
    margin: dict[str, Array]
    sigma: dict[str, Array]
    nonlinearity: dict[str, Array]

    @property
    def score(self) -> dict[str, np.ndarray]:
        """The margins divided by their standard deviations, by name; NaN where one of them is unknown."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return {name: np.asarray(x) / np.asarray(self.sigma[name]) for name, x in self.margin.items()}

    @property
    def closest(self) -> dict[str, Closest]:
        """The instant with the smallest score of each limit."""
        return {name: self._closest(name, score) for name, score in self.score.items()}

    def _closest(self, name: str, score: np.ndarray) -> Closest:
        if np.isnan(score).all():
            return UNKNOWN
        k = int(np.nanargmin(score))
        time, margin, sigma = (float(np.asarray(x)[k]) for x in (self.time, self.margin[name], self.sigma[name]))
        return Closest(time, margin, sigma, float(score[k]), 0.5 * math.erfc(-float(score[k]) / math.sqrt(2)))

    @property
    def result(self) -> str:
        """A text for each limit: the probability at its closest instant, this instant and the score there.

        A violation at an instant without a known standard deviation, such as next to a stop, is mentioned, too. The
        last line says that the probabilities are of first order, and where the nonlinearity is large.
        """
        closest = self.closest
        lines = [_sentence(name, x) + self._unknown(name) for name, x in closest.items()]
        if all(math.isnan(x.score) for x in closest.values()):
            return "\n".join(lines)
        rough = [f"{name} ({self._nonlinearity(name):.2g})" for name in closest if self._nonlinearity(name) > NONLINEAR]
        note = f" It is large for {', '.join(rough)}, whose probability is rough." if rough else ""
        return "\n".join([*lines, FIRST_ORDER + note])

    def _nonlinearity(self, name: str) -> float:
        """Return the nonlinearity at the closest instant of a limit."""
        score = self.score[name]
        return math.nan if np.isnan(score).all() else float(np.asarray(self.nonlinearity[name])[np.nanargmin(score)])

    def _unknown(self, name: str) -> str:
        """Describe the largest violation at instants without a standard deviation."""
        margin = np.where(np.isnan(self.score[name]), np.asarray(self.margin[name]), np.nan)
        if not (margin < 0).any():
            return ""
        k = int(np.nanargmin(margin))
        violation = f"{-margin[k]:.3g} {quantity(name).label}".removesuffix(" -")
        return f" At {float(np.asarray(self.time)[k]):.4g} s, where sigma is unknown, it is violated by {violation}."

    def plot(self, *names: str) -> Figure:
        """Plot the margins over time, each with a band of two standard deviations on both sides (extra `viz`).

        **Raises:** ModuleNotFoundError with the extra to install, if matplotlib is missing; ValueError for a limit that
        the result does not contain.
        """
        return draw("margin_plot", self, names)

    def record(self) -> Record:
        """Return the margins, their standard deviations and scores over `time`, each a variable."""
        variables = {}
        for name, margin in self.margin.items():
            entry = quantity(name)
            about = f"distance from the limit on the {entry.meaning}"
            variables[f"{name}_margin"] = Quantity(margin, entry.unit, about, ("time",))
            sigma, score = self.sigma[name], self.score[name]
            variables[f"{name}_sigma"] = Quantity(sigma, entry.unit, f"standard deviation of the {about}", ("time",))
            variables[f"{name}_score"] = Quantity(score, "1", f"{about}, in standard deviations", ("time",))
        time = Quantity(self.time, "s", "time from the start of the path", ("time",))
        scores = ", ".join(f"{name} {_sigmas(x.score)}" for name, x in self.closest.items())
        return Record(f"{times_text(self.time)}: {scores}", variables, {"time": time}, {"frame": "world"})


@of_one_device
def margin_uncertainty(
    fitted: Fitted | FittedRoute, limits: Limits, times: ArrayInput | None = None
) -> MarginUncertainty:
    """Return the margins of limits along a fitted path with their standard deviations, by the delta method.

    The standard deviations are those of `uncertainty`. The probability refers to one instant, the closest one: the
    limit is violated somewhere on the path at least as probably as there. The instants are samples; `certify` proves
    limits between them, for the fitted path itself. At stops and next to them the margins are not known (see
    `uncertainty`).

    Args:
        fitted: The result of `fit` or `fit_route`.
        limits: The limits, which may change along the way; the distance along the way then counts as exact.
        times: (n,) [s] from the start of the path. By default eight instants for each segment of a route, and at least
            513.

    Returns:
        A `MarginUncertainty`, whose `result` is one sentence for each limit, and whose `closest` are the instants at
        which the limits are closest.

    Raises:
        ValueError: If `fitted` is not the result of a fit, for limits that are no `Limits`, are empty or depend on the
            speed, and for times outside the path.

    Example:
        >>> import numpy as np, qtraj as qt
        >>> t = np.arange(0.0, 20.0, 0.1)
        >>> noise = np.random.default_rng(0).normal(0, 0.02, (200, 3))
        >>> fitted = qt.fit_route(qt.Track(t, np.stack([8 * t, 20 * np.sin(0.3 * t), 0 * t], 1) + noise))
        >>> qt.margin_uncertainty(fitted, qt.Limits(yaw_rate=0.4)).closest["yaw_rate"].probability > 0.99
        True
    """
    known = require_fit(fitted)
    require_limits(limits)
    refuse_obstacles(limits, "margin_uncertainty", "omit keep_out")
    given: Any = limits.on(known.path).given()
    if not given:
        raise ValueError("the limits are empty: pass at least one limit, such as Limits(curvature=0.05)")
    by_speed = {name: x for name, x in given.items() if isinstance(x, OfSpeed)}
    refuse_changing(by_speed, "margin_uncertainty", "compare the values and sigmas of qtraj.uncertainty with it")
    t = _default_times(known) if times is None else instants(known, times)
    entries = {name: quantity(name) for name in given}
    found: dict[str, Any] = propagate(known, t, entries, limits.road(np.float64))
    bounds = {name: _bound(known.path, t, x) for name, x in given.items()}
    margin = {name: quantity(name).side * (bounds[name] - x.value) for name, x in found.items()}
    return MarginUncertainty(t, margin, *({name: x[k] for name, x in found.items()} for k in (1, 2)))


def _bound(path: Any, t: np.ndarray, bound: Any) -> Any:
    if isinstance(bound, Along):
        return np.asarray(bound.at(distances(path).at(t)), float)
    return float(np.asarray(bound))


def _default_times(fitted: Any) -> Any:
    segments = fitted.path.segments if isinstance(fitted, FittedRoute) else 0
    return np.linspace(0.0, float(np.asarray(fitted.path.duration)), max(SAMPLES, PER_SEGMENT * segments))


def _sentence(name: str, closest: Closest) -> str:
    if math.isnan(closest.score):
        return f"{name}: no margin is known at these instants."
    violated = closest.score < 0
    chance = 1 - closest.probability if violated else closest.probability
    return (
        f"{name}: {'violated' if violated else 'satisfied'} with {_percent(chance)} at the closest instant, "
        f"{closest.time:.4g} s, where the margin is {_sigmas(closest.score)}."
    )


def _sigmas(score: float) -> str:
    return (
        f"{score:.2g} sigma"
        if not abs(score) > MANY
        else f"{'more' if score > 0 else 'less'} than {math.copysign(MANY, score):.0f} sigma"
    )


def _percent(chance: float) -> str:
    return "more than 99.99 %" if chance > 0.9999 else f"{100 * chance:.4g} %"
