"""Draw the figures of the README and of the pages on conventions and concepts into docs/figures.

Run it from the folder of the project:  .venv/bin/python docs/pictures.py [NAME ...]

Without names it draws all figures. docs/accuracy.md and docs/performance.md name the commands that draw their figures.
"""

import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

jax.config.update("jax_enable_x64", True)

import qtraj as qt  # noqa: E402
from qtraj.io.dataset import path_dataset  # noqa: E402
from qtraj.viz import figures  # noqa: E402
from qtraj.viz.obstacles import draw_body, draw_obstacles  # noqa: E402
from qtraj.viz.style import RC  # noqa: E402

FOLDER = Path(__file__).with_name("figures")
WORLD, BODY, VECTOR = "0.35", "#0072B2", "#D55E00"
ANGLE = np.radians(35.0)  # by which the body is rotated in the figure of the conventions


def tuning() -> Figure:
    """A recorded turn before and after tuning, as `qtraj tune` draws it without a scenario."""
    track = qt.read_track(files("qtraj.io") / "data" / "boreas_right_angle.csv").window(1093.5, 1099.5)
    before = qt.fit(track, radius_bounds=(12, 40)).path
    limits = qt.Limits(curvature=1 / 22.5, lateral_acceleration=1.5)
    start, end, axis = before.state(0.0), before.state(before.duration), before.placement
    best = qt.tune(start, end, limits, motion="hermite", duration=before.duration, placement=axis)
    paths = {"before": before, "after": best.path}
    data = path_dataset(paths, limits, track, attributes={"title": "Right-angle turn for a city bus"})
    return figures.tuning_figure(data)


def trihedra() -> Figure:
    """A climbing, widening spiral-helix with its natural trihedra."""
    path = qt.SpiralHelix([8.0, 0.8], [0.0, 0.6], [0.0, 1.0], 8.0)
    return figures.path_figure(path_dataset({"spiral-helix": path}), trihedra=7)


def orientation() -> Figure:
    """The natural trihedral along one and a half turns of a helix: the Gibbs vector is infinite where Φ = 180°."""
    program = qt.FrameProgram(qt.SpiralHelix([10.0], [0.0, 0.5], [0.0, 1.0], 18.0))
    times = jnp.linspace(0.0, program.duration, 601)
    return figures.orientation_figure(times, jax.vmap(lambda t: program(t).quaternion)(times))


def turns() -> Figure:
    """A slew of 90° with five profiles, under the same limits."""
    limits = {"max_rate": np.radians(20.0), "max_acceleration": np.radians(10.0)}
    laws = {
        "time-optimal": qt.TimeOptimal(**limits),
        "S-curve": qt.SCurve(**limits, max_jerk=np.radians(10.0)),
        "cubic": qt.Cubic(**limits),
        "quintic": qt.Quintic(**limits),
        "septic": qt.Septic(**limits),
    }
    one, quarter = jnp.array([1.0, 0.0, 0.0, 0.0]), qt.rotation.from_rotation_vector(jnp.array([0.0, 0.0, np.pi / 2]))
    profiles = {name: qt.EulerTurn(one, quarter, law).profile for name, law in laws.items()}
    return figures.profiles_figure(profiles, **limits)


def conventions() -> Figure:
    """Draw the passive and the active interpretation of λ: two sets of components of one vector, or two vectors."""
    turn = qt.rotation.from_rotation_vector(jnp.array([0.0, 0.0, ANGLE]))
    with mpl.rc_context(RC):
        figure = Figure(figsize=(9.4, 4.1))
        left, right = figure.subplots(1, 2)
        _passive(left, turn)
        _active(right, turn)
        for axes in (left, right):
            axes.set(xlim=(-1.0, 1.65), ylim=(-0.5, 1.6), aspect="equal")
            axes.axis("off")
        figure.subplots_adjust(left=0.01, right=0.99, top=0.9, bottom=0.02, wspace=0.04)
    return figure


def _passive(axes, turn) -> None:
    body = jnp.array([1.15, 0.45, 0.0])
    world = np.asarray(qt.quaternion.rotate(turn, body))
    axes.set_title("passive: one vector, two sets of components", fontweight="bold")
    _bases(axes, turn)
    _arc(axes, 0.33, 0.0, ANGLE, label=0.4)
    _arrow(axes, world, VECTOR, "v", lw=2.4)
    for basis, color, values in ((np.eye(2), WORLD, world[:2]), (_axes_of(turn), BODY, np.asarray(body[:2]))):
        for component, direction in zip(values, basis, strict=True):
            foot = component * direction
            axes.plot(*zip(world[:2], foot, strict=True), color=color, lw=0.9, ls=(0, (3, 2)), zorder=1)
            axes.plot(*foot, "o", color=color, ms=4)
    axes.text(
        0.3, -0.4, r"$v_\xi = \lambda\circ v_X\circ\lambda^{-1},\quad v_X = \alpha\,v_\xi$", ha="center", fontsize=12
    )


def _active(axes, turn) -> None:
    before = jnp.array([1.15, 0.45, 0.0])
    after = np.asarray(qt.quaternion.rotate(turn, before))
    axes.set_title("active: one set of components, two vectors", fontweight="bold")
    _bases(axes, turn)
    _arrow(axes, np.asarray(before), WORLD, "v", lw=2.4)
    _arrow(axes, after, BODY, "R(λ)v", lw=2.4)
    start = np.arctan2(before[1], before[0])
    _arc(axes, np.linalg.norm(before), start, start + ANGLE, label=0.2)
    axes.text(0.3, -0.4, r"$R(\lambda)\,v = \lambda\circ v\circ\lambda^{-1}$", ha="center", fontsize=12)


def _bases(axes, turn) -> None:
    """Inertial and body axes; the third axis of each points towards the reader."""
    for basis, color, names in ((np.eye(2), WORLD, "ξη"), (_axes_of(turn), BODY, "XY")):
        for direction, name in zip(basis, names, strict=True):
            _arrow(axes, 1.42 * direction, color, name, lw=1.1)


def _axes_of(turn) -> np.ndarray:
    """The body axes X and Y in inertial components: rows of α."""
    return np.asarray(qt.rotation.to_dcm(turn))[:2, :2]


def _arrow(axes, tip, color, name, lw) -> None:
    tip = np.asarray(tip)[:2]
    axes.annotate(
        "", tip, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": color, "lw": lw, "shrinkA": 0, "shrinkB": 0}
    )
    axes.text(*(tip + 0.09 * tip / np.linalg.norm(tip)), name, color=color, ha="center", va="center", fontsize=11)


def _arc(axes, radius, start, end, label) -> None:
    """An arrow along the rotation by Φ; `label` is the position of the letter, as a fraction of the arc."""
    angles = np.linspace(start, end, 60)
    points = radius * np.stack([np.cos(angles), np.sin(angles)])
    axes.plot(*points[:, :-4], color=VECTOR, lw=1.4)
    style = {"arrowstyle": "-|>", "color": VECTOR, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", points[:, -1], points[:, -6], arrowprops=style)
    axes.text(
        *((1 + 0.1 / radius) * points[:, int(60 * label)]), "Φ", color=VECTOR, ha="center", va="center", fontsize=11
    )


def braking() -> Figure:
    """The fastest timing along a winding road, with 4 m/s² of braking and 1.5 m/s² of acceleration."""
    points = [[0, 0, 0], [60, 0, 0], [110, 30, 0], [130, 80, 0], [180, 100, 0], [250, 90, 0], [300, 60, 0]]
    limits = qt.Limits(speed=20.0, lateral_acceleration=3.0, longitudinal_acceleration=(-4.0, 1.5))
    timed = qt.retime(qt.Shape.through(points), limits, start_speed=0.0, end_speed=0.0)
    return qt.speed_profile(timed).plot("Braking with 4 m/s², accelerating with 1.5 m/s²")


def obstacles() -> Figure:
    """A road past two obstacles, given and tuned, and the three discs of a car at some instants."""
    x = np.linspace(0.0, 60.0, 7)
    states = (np.stack([v, 0 * x, 0 * x], axis=1) for v in (x, 0 * x + 5.0, 0 * x))
    given = qt.Route(x / 5.0, *states)
    walls = qt.ConvexPolygon([[37, -4], [44, -4], [44, -0.5], [37, -0.5]])
    limits = qt.Limits(
        speed=7.0,
        lateral_acceleration=2.5,
        keep_out=[qt.Ball([17.0, 0.4, 0.0], 1.2), walls],
        body=[(-1.3, 1.1), (0.0, 1.1), (1.3, 1.1)],
    )
    best = qt.tune_route(given, limits, tube=4.0)
    with mpl.rc_context(RC):
        figure = Figure(figsize=(7.2, 1.9))
        axes = figure.add_axes((0.08, 0.24, 0.9, 0.72))
        draw_obstacles(axes, limits)
        for path, label, color in ((given, "given", "0.5"), (best.path, "tuned", BODY)):
            r = np.asarray(path.sampled(np.linspace(0, float(path.duration), 301), 0)[0])
            axes.plot(*r[:, :2].T, color=color, lw=1.2, label=label)
        draw_body(axes, limits, best.path, np.linspace(0, float(best.path.duration), 11))
        axes.set_aspect("equal")
        axes.set(xlabel="x [m]", ylabel="y [m]", xlim=(-4, 64), ylim=(-5, 5))
        axes.legend(loc="upper right", fontsize=8, ncols=2)
    return figure


def zones() -> Figure:
    """The fastest timing along the same road with limits on the speed that change along the way."""
    points = [[0, 0, 0], [60, 0, 0], [110, 30, 0], [130, 80, 0], [180, 100, 0], [250, 90, 0], [300, 60, 0]]
    speed = qt.Along([0.0, 150.0, 250.0], [13.9, 8.3, 13.9])
    limits = qt.Limits(speed=speed, lateral_acceleration=3.0, longitudinal_acceleration=(-4.0, 1.5))
    timed = qt.retime(qt.Shape.through(points), limits, start_speed=0.0, end_speed=0.0)
    return qt.speed_profile(timed).plot("50 km/h, and 30 km/h from 150 m to 250 m")


def by_speed() -> Figure:
    """The longitudinal acceleration over the speed along the same road, timed within a motor and a brake curve."""
    points = [[0, 0, 0], [60, 0, 0], [110, 30, 0], [130, 80, 0], [180, 100, 0], [250, 90, 0], [300, 60, 0]]
    curves = qt.BySpeed([0, 8, 20], lower=[-4, -4, -2.5], upper=[3, 2.5, 0.8])
    limits = qt.Limits(speed=20.0, lateral_acceleration=3.0, longitudinal_acceleration=curves)
    timed = qt.retime(qt.Shape.through(points), limits, start_speed=0.0, end_speed=0.0)
    found = qt.evaluate(timed.path, np.linspace(0, float(timed.duration), 2001), ("speed", "longitudinal_acceleration"))
    with mpl.rc_context(RC):
        figure = Figure(figsize=(5.2, 2.6))
        axes = figure.add_axes((0.12, 0.18, 0.85, 0.78))
        axes.plot(np.asarray(found.speed), np.asarray(found.longitudinal_acceleration), color=BODY, label="path")
        for values, label in zip(np.asarray(curves.values).T, ("limits", None), strict=True):
            axes.plot(np.asarray(curves.speeds), values, "--", color=VECTOR, lw=1.8, label=label)
        axes.set(xlabel="speed [m/s]", ylabel="longitudinal acceleration [m/s²]", xlim=(0, 20), ylim=(-4.6, 3.6))
        axes.legend(loc="center left", fontsize=8)
    return figure


def atlas() -> Figure:
    """How fast a bus may enter a corner of 90° that it leaves 25 m from its axis, over the radius at the entry."""

    def corner(radius: float, speed: float):
        start = qt.BoundaryState([radius, 0.0, 0.0], [0.0, speed, 0.0])
        end = qt.BoundaryState([0.0, 25.0, 0.0], [-speed, 0.0, 0.0])
        limits = qt.Limits(curvature=1 / 12, lateral_acceleration=1.5, longitudinal_acceleration=(-1.5, 1.0))
        return start, end, limits

    along_streets = ["start.V_rho", "start.V_phi", "start.V_h", "end.V_rho", "end.V_h"]
    tuned = qt.tuned_points(corner, objective="fastest", motion="hermite", fixed=along_streets, starts=2)
    radius = qt.AtlasAxis("radius_at_the_entry", 10.0, 50.0, tolerance=0.35, unit="m")
    speed = qt.AtlasAxis("speed_at_the_entry", 2.0, 10.0, tolerance=0.07, unit="m/s")
    found = qt.atlas(tuned, radius, speed, follow="limit")
    return figures.atlas_figure(found, title="A corner for a city bus")


PICTURES: dict[str, Callable[[], Figure]] = {
    "tuning": tuning,
    "conventions": conventions,
    "trihedra": trihedra,
    "orientation": orientation,
    "turns": turns,
    "braking": braking,
    "obstacles": obstacles,
    "zones": zones,
    "by_speed": by_speed,
    "atlas": atlas,
}
"""The name of each file, and the function that draws it."""


def main(names: list[str]) -> None:
    """Draw the figures with these names, or all of them."""
    for name in names or PICTURES:
        figures.save(PICTURES[name](), FOLDER / f"{name}.svg")


if __name__ == "__main__":
    main(sys.argv[1:])
