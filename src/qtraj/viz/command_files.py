"""The files that each command writes, as writers by file name, from results of the library (extras `io` and `viz`).

`about` contains attributes of the datasets, such as a title. `qtraj.foundation.folder.write_all` writes the files.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray

from qtraj.design.fitting.fitted import Fitted
from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.robust.box_outcome import BoxTuned
from qtraj.design.robust.outcome import RobustTuned
from qtraj.design.speed_profile import SpeedProfile
from qtraj.design.timing.outcome import Retimed
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.folder import Writer
from qtraj.foundation.record import to_dataset
from qtraj.io.dataset import path_dataset
from qtraj.io.retimed_dataset import retimed_dataset
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.motion.programs.slew_history import SlewHistory
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.body import RigidBody
from qtraj.motion.simulation.loop_facts import limit_of
from qtraj.motion.simulation.loop_history import LoopHistory
from qtraj.motion.simulation.loop_verdict import LoopVerdict
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track
from qtraj.path.trihedral import Upright
from qtraj.viz import figures
from qtraj.viz.result_files import documents, figure, netcdf, report, table

BOUNDED = {"max_rate": "angle_rate", "max_acceleration": "angle_acceleration", "max_torque": "torque"}
"""The variable of a slew to which each limit applies."""


def tuned_files(
    path: SpiralHelix,
    before: Certificate,
    tuned: Tuned,
    limits: Limits,
    frame: Frame | None = None,
    track: Track | None = None,
    fitted: Fitted | None = None,
    about: Mapping[str, str] | None = None,
) -> dict[str, Writer]:
    """Return the files of `qtraj tune`: the dataset of the original `path` and the tuned path, documents and a figure.

    `before` is the certificate of the original path, and `frame` the frame of the dataset.
    """
    dataset = path_dataset(
        {"before": path, "after": tuned.path},
        limits,
        track,
        attributes=about,
        fitted=fitted,
        frame=frame,
        findings={"before": before, "after": tuned.certificate},
    )
    return {
        **netcdf("paths.nc", dataset),
        **documents({"path.toml": tuned.path, "tuning.toml": tuned}),
        **figure("tuning", figures.tuning_figure(dataset, limits)),
    }


def route_files(
    dataset: xarray.Dataset,
    fitted: FittedRoute,
    certificate: RouteCertificate | None = None,
    tuned: TunedRoute | None = None,
    limits: Limits | None = None,
    robust: RobustTuned | BoxTuned | None = None,
) -> dict[str, Writer]:
    """Return the files of `qtraj route`: the dataset from `route_dataset`, documents, figures and the report.

    The figure shows the obstacles of `limits`. `robust` is the result of a tuning with margins.
    """
    named = {
        "route.json": fitted.path if tuned is None else tuned.path,
        "fit.json": fitted,
        "certificate.json": certificate if tuned is None else tuned.certificate,
        "tuning.json": tuned,
        "robust.json": robust,
    }
    drawn = figure("route", figures.route_figure(dataset, limits))
    return {**netcdf("paths.nc", dataset), **documents(named), **drawn, **report(dataset)}


def retimed_files(
    timed: Retimed,
    profile: SpeedProfile,
    limits: Limits | None = None,
    certificate: Certificate | None = None,
    track: Track | None = None,
    fitted: Fitted | FittedRoute | None = None,
    about: Mapping[str, str] | None = None,
) -> dict[str, Writer]:
    """Return the files of `qtraj retime`: the dataset of both paths, documents, the timing, a figure and the report.

    `limits` and `certificate` are the same as for `retimed_dataset`.
    """
    about = {} if about is None else dict(about)
    turn = fitted if isinstance(fitted, Fitted) else None
    before = fitted.path if isinstance(fitted, FittedRoute) else None
    dataset = retimed_dataset(timed, limits, certificate, profile, track, turn, Upright(), about, before)
    timing = profile.to_xarray({name: about[name] for name in ("title", "scenario_file") if name in about})
    return {
        **netcdf("paths.nc", dataset),
        **documents({"path.json": timed.path, "retimed.json": timed}),
        **table(timing, "timing"),
        **figure("retime", figures.speed_profile_figure(timing)),
        **report(dataset),
    }


def slew_files(
    program: Any,
    history: SlewHistory,
    drawn: SlewHistory,
    limits: Mapping[str, float],
    max_torque: Any = None,
    about: Mapping[str, str] | None = None,
) -> dict[str, Writer]:
    """Return the files of `qtraj slew`: the program, the table of `history`, and the figure of the history `drawn`.

    `limits` [rad/s, rad/s², rad/s³] and `max_torque` [N m] are the same as for `judge_slew`.
    """
    dataset = to_dataset(history.record(), about)
    for name, limit in {**limits, "max_torque": max_torque}.items():
        if limit is not None and name in BOUNDED:
            dataset[BOUNDED[name]].attrs["limit"] = limit
    return {
        **documents({"program.toml": program}),
        **table(dataset),
        **figure("slew", figures.slew_figure(to_dataset(drawn.record(), about), dict(limits))),
    }


def loop_files(
    history: LoopHistory,
    verdict: LoopVerdict,
    actuator: Actuator | None = None,
    about: Mapping[str, str] | None = None,
    body: RigidBody | None = None,
) -> dict[str, Writer]:
    """Return the files of `qtraj simulate`: the solution, the table of the `history` and a figure."""
    limited = limit_of(actuator)
    limit, saturation = limited["command_limit"], limited["saturation"]
    closed = "applies" if verdict.applies else f"does not apply: {verdict.reason}"
    more = {"closed_form": closed} | ({} if limit is None else {"saturation": saturation})
    dataset = to_dataset(history.record(), {**(about or {}), **more})
    if limit is not None:
        dataset["command"].attrs["limit"] = limit
    for name, value in _body_limits(body).items():
        dataset[name].attrs["limit"] = np.asarray(value).tolist()
    return {
        **documents({"solution.toml": history.solution}),
        **table(dataset),
        **figure("simulation", figures.simulation_figure(dataset, float(verdict.settled_angle), limit)),
    }


def _body_limits(body: RigidBody | None) -> dict[str, Any]:
    """Return the limits on the torque of thrusters and on the momenta of wheels, by variable."""
    wheels = None if body is None else body.wheels
    limits = {"torque": body and body.max_torque, "momentum": wheels and wheels.max_momentum}
    return {name: limit for name, limit in limits.items() if limit is not None}
