"""Define tables of a path scenario: the recording, and the settings of its fit, the tuning and the retiming."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import AfterValidator

from qtraj.design.fitting.fit import BOUNDS, POSITION_SIGMA, VELOCITY_SIGMA, fit
from qtraj.design.fitting.fitted import Fitted
from qtraj.design.timing.parts import STOP_DISTANCE
from qtraj.design.timing.requirements import LEAST_TOLERANCE, MAX_KNOTS, MIN_KNOTS, require_knots, require_tolerance
from qtraj.design.tuning.choices import MOTIONS, OBJECTIVES
from qtraj.design.tuning.methods import LEARNING_RATE, adam
from qtraj.io.track.attitude_angles import AttitudeAngles
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.io.track.reading import Recording
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.io.track.track_file import read_recording
from qtraj.path.track import Track
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, checked_by, key, one_of, with_hyphens

Motion = Annotated[str, one_of(MOTIONS)]
Objective = Annotated[str, one_of(OBJECTIVES)]
Recorded = Literal["time", "position", "velocity", "attitude", "rate"]

VARIABLES = "'start.V_rho', 'start.V_phi' (hermite) and 'start.V_h', the same names with 'end', and 'duration'"
NO_LIMITS: Mapping[str, LimitColumn] = MappingProxyType({})
OPTIONS = ("max_steps", "inner_steps", "learning_rate")


class AnglesPart(Part):
    """The convention of recorded roll, pitch and heading; all keys are required."""

    sequence: keys.Text = key(
        "order of the rotations: x roll, y pitch, z heading; upper case for moving axes, lower case for fixed axes",
        values="three letters such as 'ZYX'",
    )
    heading: Literal["north-clockwise", "x-anticlockwise"] = key(
        "zero direction and positive sense of rotation of the heading"
    )
    unit: keys.Angles = key("the unit of the columns")
    body: Literal["forward-right-down", "forward-left-up"] = key(
        "directions of the body axes x, y, z; roll is positive about x and pitch about y, by the right-hand rule"
    )


class TrackPart(Part):
    """A window of a recording to which a path is fitted."""

    file: keys.Text = key(
        "the recording: a table with column names, TUM, KITTI, GPX or NMEA",
        values="the name of a file, relative to the scenario",
    )
    window: keys.Pair | None = key(
        "time interval of the recording to use; default: the whole recording",
        None,
        values="two finite times [t0, t1] in seconds on the recording's own clock",
    )
    columns: dict[Recorded, keys.Text | list[keys.Text]] | None = key(
        "names of columns that are not recognised automatically",
        None,
        values="column names of 'time', 'position', 'velocity', 'attitude' or 'rate'; an empty list omits the quantity",
    )
    units: dict[Literal["time", "position", "velocity", "rate"], keys.Text] | None = key(
        "units of the columns; default: the units in the column names, otherwise s, m, m/s, rad/s",
        None,
        values="units of 'time', 'position', 'velocity' or 'rate', such as { velocity = 'km/h' }",
    )
    axes: Literal["enu", "ned", "camera"] | None = key(
        "world axes: z up; north, east, down; or right, down, forward. Default: by the column names, otherwise z up",
        None,
    )
    rate: keys.Positive | None = key("samples per second of a file without times", None, unit="1/s")
    times: keys.Text | None = key(
        "the times of a file without times",
        None,
        values="the name of a file with one time [s] on each line, relative to the scenario",
    )
    duplicates: Literal["first", "last", "mean"] | None = key(
        "which of several rows at one time counts; default: equal rows once, and the mean of similar rows", None
    )
    quaternion: Literal["wxyz", "xyzw"] | None = key(
        "the order of a quaternion whose column names do not tell it; default: such columns are left out, and columns "
        "in `columns` have the scalar first",
        None,
    )
    segment: keys.Counts | None = key(
        "the segment of a recording whose clock jumps back, or of a GPX file; default: all segments", None
    )
    angles: AnglesPart | None = key(
        "the convention of recorded roll, pitch and heading", None, values="a table [track.angles]"
    )
    projection: Annotated[str, one_of(["tangent-plane"]), AfterValidator(with_hyphens)] | None = key(
        "conversion of latitude, longitude and height to metres; default: by the column names",
        None,
        values="'tangent-plane': east, north and up on the tangent plane of WGS 84",
    )
    origin: keys.Vector | None = key(
        "the origin of the tangent plane; default: the first sample of the file",
        None,
        values="[latitude °, longitude °, height m]",
    )
    source: keys.Text | None = key(
        "attribution of the recording, copied to the results",
        None,
        values="a string: the source and the licence of the recording",
    )

    def _faults(self) -> Iterator[str]:
        if self.window is not None and not self.window[0] < self.window[1]:
            yield f"the key 'window' has the value {self.window}, but must be [t0, t1] with t0 < t1"
        if self.origin is not None and self.projection is None:
            yield "the key 'origin' is valid only with projection = 'tangent-plane'"

    def read(self, beside: Callable[[str], Path], limits: Mapping[str, LimitColumn] = NO_LIMITS) -> Recording:
        """Read the recording and the columns of `limits`, its window as track; see `read_whole`."""
        recording = self.read_whole(beside, limits)
        return recording if self.window is None else recording._replace(track=recording.track.window(*self.window))

    def read_whole(self, beside: Callable[[str], Path], limits: Mapping[str, LimitColumn] = NO_LIMITS) -> Recording:
        """Read the recording without regard to the window; `beside` maps the name of the file to a path."""
        columns = None if self.columns is None else {name: chosen or None for name, chosen in self.columns.items()}
        angles = None if self.angles is None else AttitudeAngles(**self.angles.model_dump())
        origin = None if self.origin is None else (self.origin[0], self.origin[1], self.origin[2])
        projection = None if self.projection is None else TangentPlane(origin)
        times = None if self.times is None else beside(self.times)
        units = {str(part): unit for part, unit in (self.units or {}).items()}
        options = {name: getattr(self, name) for name in ("axes", "rate", "duplicates", "quaternion", "segment")}
        options |= {"columns": columns, "angles": angles, "projection": projection, "units": units, "times": times}
        options |= {"limits": limits}
        return read_recording(beside(self.file), **options)


class FitPart(Part):
    """The settings of the fit of a path to a recording."""

    motion: Motion | None = key(
        "angle about the axis: linear in time ('uniform'), or a polynomial ('hermite'); default: the motion in [tune]",
        None,
    )
    position_sigma: keys.Metres | None = key(
        f"standard deviation of a recorded position; default: {POSITION_SIGMA}", None
    )
    velocity_sigma: keys.Positive | None = key(
        f"standard deviation of a recorded velocity; default: {VELOCITY_SIGMA}", None, unit="m/s"
    )
    radius_bounds: keys.PositivePair | None = key(
        f"minimum and maximum radius about the axis; default: {BOUNDS[0]:g} and {BOUNDS[1]:g} times the mean radius",
        None,
        values="two positive finite radii [low, high] [m]",
    )

    def fit(self, track: Track, motion: str) -> Fitted:
        """Fit a path to a recording, with the motion of this table, or with `motion` if the table has no motion."""
        settings = self.model_dump(exclude_none=True)
        if self.radius_bounds is not None:
            settings["radius_bounds"] = tuple(map(float, self.radius_bounds))
        return fit(track, **{"motion": motion, **settings})


class TunePart(Part):
    """The settings of the tuning."""

    objective: Objective = key(
        "the quantity to minimise: the change of the boundary velocities, and of the duration of a hermite path "
        "('nearest'); the duration ('fastest'); or the integral of the squared jerk ('smoothest')",
        "nearest",
    )
    motion: Motion | None = key(
        "angle about the axis: linear in time ('uniform'), or a polynomial ('hermite'); default: 'hermite' for a "
        "[track], otherwise 'uniform'",
        None,
    )
    duration: keys.Seconds | None = key(
        "initial duration of a hermite path, fixed for the objective 'smoothest'; default: the duration of a fitted or "
        "saved path; between two states, computed from the angular rates about the axis at both states",
        None,
    )
    turns: keys.Wholes | None = key("additional whole turns about the axis", None)
    fixed: list[keys.Text] = key(
        f"variables that are held fixed: {VARIABLES}; also 'start.heading' and 'end.heading'",
        [],
        values='a list of names, as in fixed = ["end.V_h"]',
    )
    bounds: keys.RangeMap = key(
        "ranges of variables; other variables have the default bounds of the search",
        {},
        values="a table [tune.bounds] of ranges [low, high] in m/s or s: duration = [4.0, 8.0], or with one bound: "
        'duration = {max = 8.0}, or {min = 4.0}; a name with a dot needs quotes: "end.V_h" = [-0.5, 0.5]',
    )
    corridor: keys.Metres | None = key(
        "maximum distance d between the original and the tuned path, at the same fraction of their durations: "
        "d² = Δρ² + ρ₁ρ₂Δφ² + Δh² with the differences Δ of radius ρ, azimuth φ and height h, and both radii ρ₁, ρ₂",
        None,
    )
    nearest_to: keys.Text | None = key(
        "a saved path that replaces the original path in the objective 'nearest'",
        None,
        values="the name of a saved path, relative to the scenario",
    )
    starts: keys.Counts = key(
        "number of starting points of the search: the specified states, and perturbations of these states", 8
    )
    method: Literal["sqp", "lbfgs", "adam"] = key(
        "search method: sequential quadratic programming ('sqp'), or first steps of an optax optimiser ('lbfgs' or "
        "'adam') from every start, and then 'sqp' from the best results",
        "sqp",
    )
    max_steps: keys.Counts | None = key("maximum number of iterations of 'sqp'; default: 300", None)
    inner_steps: keys.Counts | None = key(
        "number of steps of 'lbfgs' or 'adam' before 'sqp' continues; default: 600", None
    )
    learning_rate: keys.Positive | None = key(
        f"learning rate of 'adam', in units of the reference speed; default: {LEARNING_RATE}", None
    )

    def _faults(self) -> Iterator[str]:
        if self.learning_rate is not None and self.method != "adam":
            yield f"learning_rate is valid only with method = 'adam', but the method is {self.method!r}"
        if self.inner_steps is not None and self.method == "sqp":
            yield "inner_steps is valid only with method = 'lbfgs' or 'adam', but the method is 'sqp'"

    @property
    def options(self) -> dict[str, Any]:
        """The options of the method that are set."""
        return {name: getattr(self, name) for name in self.given(*OPTIONS)}

    @property
    def ranges(self) -> dict[str, tuple[float | None, float | None]]:
        """The lower and the upper bound of each bounded variable by name; None for a missing bound."""
        bounds = self.bounds.items()
        return {name: (x.get("min"), x.get("max")) if isinstance(x, dict) else (x[0], x[1]) for name, x in bounds}

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of `qtraj.tune` that depend only on this table."""
        options = self.options
        rate = options.pop("learning_rate", LEARNING_RATE)
        settings = {"fixed": tuple(self.fixed), "bounds": self.ranges, "corridor": self.corridor}
        return settings | options | {"method": adam(rate) if self.method == "adam" else self.method}


class RetimePart(Part):
    """Settings of `qtraj retime`; other commands ignore this table."""

    shape: Literal["route", "spiral-helix"] | None = key(
        "the class of path fitted to a [track]; default: a route, unless [fit] or [tune] has keys of a spiral-helix",
        None,
    )
    start_speed: keys.Speed | None = key("speed at the start, 0 for rest; default: as high as the limits allow", None)
    end_speed: keys.Speed | None = key("speed at the end, 0 for rest; default: as high as the limits allow", None)
    knots: Annotated[int, checked_by(require_knots)] | None = key(
        "minimum number of timing cells of equal length between two stops; default: cells chosen for `tolerance`",
        None,
        values=f"a power of two from {MIN_KNOTS} to {MAX_KNOTS}",
    )
    tolerance: Annotated[float, checked_by(require_tolerance)] = key(
        "relative distance of the duration from the minimum at which the cells are small enough; only without `knots`",
        1e-3,
        values=f"a number from {LEAST_TOLERANCE:g} to below 1",
    )
    stop_speed: keys.Speed = key(
        "speed at or below which slow motion on a route is replaced by a stop, if the vehicle also stays within "
        "`stop_distance`; with 0, nothing is replaced",
        0.0,
    )
    stop_distance: keys.NotNegative | None = key(
        f"maximum distance of a stopped vehicle from its position when the stop starts; default: {STOP_DISTANCE} m",
        None,
        unit="m",
    )
