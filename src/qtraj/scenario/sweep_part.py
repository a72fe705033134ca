"""Define the keys of the table [sweep]: what is computed, and the parameters by the names of scenario keys."""

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field

from qtraj.batch.reduction import REDUCTIONS
from qtraj.foundation.argument import described
from qtraj.foundation.suggestion import suggestion
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key, one_of
from qtraj.scenario.point_expression import PointExpression
from qtraj.sweeps.distributions import Column, Normal, Uniform
from qtraj.sweeps.draws import DESIGNS
from qtraj.sweeps.parameters import MOST_POINTS

RUNS = ("tune", "certify", "evaluate", "retime", "route", "simulate")
"""What a sweep computes at each point."""

FORMS = (("from", "to", "steps"), ("values",), ("uniform",), ("normal",), ("file", "column"), ("expression",))
"""The keys of the table of a parameter, one of these sets."""

MOST_STEPS = 10**8
"""Maximum number of steps of a grid."""

_KEYS = {name for form in FORMS for name in form}

EXPECTED = (
    "{from, to, steps}, {values = [...]}, {uniform = [low, high]}, {normal = [mean, standard deviation]}, {file, "
    "column} or {expression = '...'}"
)


class SweepPart(Part):
    """A sweep of this scenario over parameters, for `qtraj sweep`; other commands ignore this table.

    All other keys of this table are parameters: the names of keys of the scenario with a table of values, such as
    limits.curvature = {from = 0.05, to = 0.2, steps = 16} or start.speed = {normal = [8.0, 0.5]}. The forms are {from,
    to, steps}, {values = [...]}, {uniform = [low, high]}, {normal = [mean, standard deviation]}, {file = "x.csv",
    column = "name"}, and {expression = "0.8 * start.speed"} for a function of other parameters. Components of vectors
    are the names x, y and z, as in end.position.z; start.speed and end.speed scale the velocity.
    """

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    run: Annotated[str, one_of(RUNS)] | None = key(
        "what is computed: 'tune', 'certify', 'evaluate' or 'retime' for paths, 'route' for recorded drives, "
        "'simulate' for closed loops; default: 'tune', 'route' or 'simulate'",
        None,
    )
    samples: keys.Counts | None = key("number of samples of the random parameters", None)
    design: Annotated[str, one_of(DESIGNS)] = key(
        "how samples are drawn: independently ('random'), as a Latin hypercube ('latin') or as a Sobol sequence "
        "('sobol')",
        "random",
    )
    seed: keys.Wholes = key("seed of the samples", 0)
    shard: keys.Counts | None = key("number of points of each task; default: depends on what is computed", None)
    keep: bool = key("whether each point is stored, and not only its status and the summaries", True, values="a bool")
    outputs: list[keys.Text] = key(
        "outputs of 'evaluate'", ["speed", "curvature"], values="names of outputs of qtraj.evaluate"
    )
    reduce: Annotated[str, one_of(REDUCTIONS)] = key("how 'evaluate' reduces its outputs over time", "max")
    histograms: dict[str, Annotated[list[keys.Number], Field(min_length=2, max_length=2)]] = key(
        "ranges of outputs for quantiles", {}, values="a table of ranges [low, high]"
    )

    def _faults(self) -> Iterator[str]:
        given = dict(_flat(self.model_extra or {}))
        for name, value in given.items():
            if not isinstance(value, dict):
                known = (*type(self).model_fields, "limits.curvature")
                yield (
                    f"the parameter '{name}' has the value {described(value)}, but must be {EXPECTED}; "
                    f"{suggestion(name, known)}"
                )
            elif tuple(value) not in FORMS and set(value) not in map(set, FORMS):
                yield f"the parameter '{name}' has the keys {', '.join(value)}, but must be {EXPECTED}"
            else:
                yield from _fault_of(name, value)
        if not given:
            yield "there are no parameters: add one, such as limits.curvature = {from = 0.05, to = 0.2, steps = 16}"
        yield from _faults_together(given, self.samples)

    def parameters(self, beside: Callable[[str], Path]) -> dict[str, Any]:
        """Return the parameters of `qtraj.sweep` by the dotted names of keys; `beside` maps a file name to its path.

        **Raises:** OSError or ValueError if a file with a column cannot be read.
        """
        found = {name: _source(value, beside) for name, value in _flat(self.model_extra or {})}
        own = {name: x for name, x in found.items() if not isinstance(x, PointExpression)}
        return own | {name: found[name] for name in _in_order(found)}


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of each parameter in nested tables."""
    for name, value in table.items():
        if isinstance(value, dict) and not _KEYS & value.keys():
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _faults_together(given: Mapping[str, Any], samples: int | None) -> Iterator[str]:
    """Yield messages about parameters that are valid one by one."""
    kinds = {name: next(iter(value)) for name, value in given.items()}
    random = [name for name, kind in kinds.items() if kind in ("uniform", "normal")]
    columns = [name for name, kind in kinds.items() if kind in ("file", "column")]
    if random and not columns and samples is None:
        yield f"the parameter '{random[0]}' is random: add samples, such as samples = 1000"
    if samples is not None and not random and not columns:
        yield "samples is the number of random points, but no parameter is {uniform = [...]} or {normal = [...]}"
    sizes = [len(_source(given[n], Path)) for n, kind in kinds.items() if kind in ("from", "to", "steps", "values")]
    if (count := math.prod(sizes) * (samples or 1)) > MOST_POINTS:
        yield (
            f"the parameters define {count:.3g} points, but a sweep has at most {MOST_POINTS:.0e}: use fewer steps or "
            "values, or {uniform = [low, high]} with samples = 1000000 and design = 'sobol'"
        )
    found = {name: _source(given[name], Path) for name, kind in kinds.items() if kind == "expression"}
    for name, expression in found.items():
        if unknown := sorted(expression.names - given.keys()):
            yield (
                f"the expression of the parameter '{name}' contains '{unknown[0]}', which is no parameter of this "
                f"sweep; {suggestion(unknown[0], [n for n in given if n != name])}"
            )
    if len(found) == len(given) or len(_in_order(found)) < len(found):
        yield f"the expressions of {', '.join(found)} depend on each other: give one of these parameters values"


def _in_order(found: Mapping[str, Any]) -> list[str]:
    """Return the names of expressions, each after those that it contains, without those that depend on each other."""
    waiting = {name: x.names for name, x in found.items() if isinstance(x, PointExpression)}
    ordered: list[str] = []
    while ready := [name for name, own in waiting.items() if not own & waiting.keys()]:
        ordered += ready
        waiting = {name: own for name, own in waiting.items() if name not in ready}
    return ordered


def _fault_of(name: str, value: dict[str, Any]) -> Iterator[str]:
    try:
        if "file" not in value:
            _source(value, Path)
        elif not all(isinstance(x, str) for x in value.values()):
            yield f"the parameter '{name}' must have the names of a file and of a column"
    except (TypeError, ValueError) as error:
        yield f"the parameter '{name}': {error}"


def _source(value: dict[str, Any], beside: Callable[[str], Path]) -> Any:
    match value:
        case {"values": []}:
            raise ValueError("it has no values: add at least one to values = [...]")
        case {"values": [*values]} if all(_is_number(x) for x in values):
            return np.asarray(values)
        case {"uniform": [low, high]}:
            return Uniform(low, high)
        case {"normal": [mean, sigma]}:
            return Normal(mean, sigma)
        case {"expression": str(text)}:
            return PointExpression(text)
        case {"file": str(file), "column": str(column)}:
            return Column(beside(file), column)
        case {"from": first, "to": last, "steps": int(steps)} if _are_ends(first, last) and steps > 0:
            if steps is not True:
                return _spaced(first, last, steps)
    raise ValueError(f"{value} was given, but {EXPECTED} was expected")


def _spaced(first: float, last: float, steps: int) -> np.ndarray:
    """Return equally spaced numbers, which are integers if the ends and the distance are."""
    if steps > MOST_STEPS:
        raise ValueError(
            f"steps is {steps}, but a grid has at most {MOST_STEPS} points: use {{uniform = [low, high]}} and samples"
        )
    values = np.linspace(first, last, steps)
    whole = isinstance(first, int) and isinstance(last, int) and (values == np.round(values)).all()
    return values.astype(int) if whole else values


def _are_ends(*ends: Any) -> bool:
    return all(_is_number(x) and not isinstance(x, bool) for x in ends)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)
