"""What the keys of all scenario files are made of.

The `title` of a key says what it means. Its `description` says what it may hold and completes the sentence
"expected …", which is a message when the value is another. docs/scenarios.md is made of both.
"""

import sys
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag


def _form(value: Any) -> str:
    """Which form of a range a value has; anything else is judged as a pair."""
    return "open" if isinstance(value, dict) and value and value.keys() <= {"min", "max"} else "pair"


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
OpenPair = Annotated[dict[Literal["min", "max"], Number], Field(min_length=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Wholes = Annotated[int, Field(ge=0)]
Counts = Annotated[int, Field(ge=1)]
Text = Annotated[str, Field(min_length=1)]

Angles = Literal["deg", "rad"]

RangeMap = dict[str, Annotated[Annotated[Pair, Tag("pair")] | Annotated[OpenPair, Tag("open")], Discriminator(_form)]]
"""Lowest and highest values by name: [low, high], or {min = low}, {max = high} for one of them."""

NAME = "a name for titles"
ABOUT = "what the scenario is about"
UNIT = "the unit of angles"
TEXT = "a text"
POSITIVE_SECONDS = "a positive finite number [s]"
THREE = "three finite numbers [x, y, z]"
ANGLES = "'deg' or 'rad': the unit of every angle in this file, also in rates (per s) and accelerations (per s²)"


def is_number(x: Any) -> bool:
    """Whether a value of a TOML file is a finite number that a float can hold."""
    return isinstance(x, int | float) and not isinstance(x, bool) and abs(x) <= sys.float_info.max


class Part(BaseModel):
    """A table of a scenario file: unknown keys, other types and infinite numbers are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def given(part: Part, *names: str) -> list[str]:
    """Those of the keys that are set."""
    return [name for name in names if getattr(part, name) is not None]
