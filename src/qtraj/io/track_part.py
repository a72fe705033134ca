"""The keys of a recording in a scenario: the file, the part of it that counts, and what its columns mean."""

from typing import Literal

from pydantic import Field, model_validator

from qtraj.io.scenario_part import Angles, Pair, Part, Text, Vector


class AnglesPart(Part):
    """What roll, pitch and heading of a recording mean; every key is needed, nothing is guessed."""

    sequence: Text = Field(
        title="order of the turns: x roll, y pitch, z heading; upper case about moving axes, lower about fixed ones",
        description="three letters such as 'ZYX'",
    )
    heading: Literal["north-clockwise", "x-anticlockwise"] = Field(
        title="from where and in which sense the heading counts",
        description="'north-clockwise' or 'x-anticlockwise'",
    )
    unit: Angles = Field(title="the unit of the columns", description="'deg' or 'rad'")
    body: Literal["forward-right-down", "forward-left-up"] = Field(
        title="the body axes x, y, z about which roll and pitch are right-handed",
        description="'forward-right-down' or 'forward-left-up'",
    )


class TrackPart(Part):
    """A window of a recording, which a path is fitted to."""

    file: Text = Field(
        title="the recording: CSV with a header, or TUM",
        description="the name of a text file, relative to the scenario",
    )
    window: Pair | None = Field(
        default=None,
        title="the part of it that counts; all if left out",
        description="two finite times [t0, t1] in seconds on the recording's own clock",
    )
    columns: dict[Literal["time", "position", "velocity", "attitude"], Text | list[Text]] | None = Field(
        default=None,
        title="names of columns where they are not common ones",
        description="column names of 'time', 'position', 'velocity' or 'attitude'; an empty list leaves a part out",
    )
    angles: AnglesPart | None = Field(
        default=None,
        title="what its roll, pitch and heading mean, where the attitude is recorded so",
        description="a table [track.angles]",
    )
    projection: Literal["tangent-plane", "tangent_plane"] | None = Field(
        default=None,
        title="how latitude, longitude and height become metres; the position is read in metres if left out",
        description="'tangent-plane': east, north and up on the tangent plane of WGS 84",
    )
    origin: Vector | None = Field(
        default=None,
        title="where the tangent plane touches; at the first sample of the file if left out",
        description="[latitude °, longitude °, height m]",
    )
    source: Text | None = Field(
        default=None,
        title="its attribution, kept in the results",
        description="a text: where the recording comes from, and its licence",
    )

    @model_validator(mode="after")
    def _ordered(self) -> "TrackPart":
        if self.window is not None and not self.window[0] < self.window[1]:
            raise ValueError(f"the key 'window' holds {self.window}, but expected [t0, t1] with t0 < t1")
        if self.origin is not None and self.projection is None:
            raise ValueError("the key 'origin' belongs to projection = 'tangent-plane'")
        return self
