"""Create labelled datasets of a fitted route and, after a tuning, of the tuned route (extra `io`)."""

from collections.abc import Mapping

import numpy as np
import xarray

from qtraj.design.fitting.fitted_route import FittedRoute
from qtraj.design.fitting.route_facts import route_fact_rows
from qtraj.design.limits import Limits
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.design.uncertainty.uncertainty import ENTRIES, VECTORS, uncertainty
from qtraj.io.dataset import limited_variables, path_dataset
from qtraj.path.track import Track

SAMPLES_PER_SEGMENT, MIN_SAMPLES, MAX_SAMPLES = 8, 513, 20_001
"""Number of instants of the dataset for each segment, and bounds on the total number of instants."""

SIGMAS = ("position", "speed", "curvature", "yaw_rate", "lateral_acceleration", "longitudinal_acceleration")
"""Variables with standard deviations, in addition to those that are limited."""

ROUTE_FACT_TEXT, ROUTE_FACT = "fit_fact_text", "fit_fact"
"""The variable with the facts of the fit as text, and its coordinate with their names."""


def route_dataset(
    fitted: FittedRoute,
    limits: Limits | None = None,
    certificate: RouteCertificate | None = None,
    tuned: TunedRoute | None = None,
    track: Track | None = None,
    attributes: Mapping[str, str] | None = None,
) -> xarray.Dataset:
    """Create a `path_dataset` of the route, named "route".

    With a tuned route, the dataset contains the fitted route, named "before", and the tuned route, named "after".
    `certificate` contains the findings on the fitted route. The facts of the fit, as the terminal shows them, are the
    variable `fit_fact_text`, with their names as its coordinate. Standard deviations of the fitted route, such as
    `yaw_rate_sigma`, are NaN for the tuned route, and where `qtraj.uncertainty` does not know them.
    """
    path, about = fitted.path, {"route_result": fitted.result}
    paths, findings = {"route": path}, {} if certificate is None else {"route": certificate.whole}
    if tuned is not None:
        paths, about = {"before": path, "after": tuned.path}, about | {"tuning_result": tuned.result}
        findings = {"after": tuned.certificate.whole}
        findings |= {} if certificate is None else {"before": certificate.whole}
    dataset = path_dataset(
        paths,
        limits,
        track,
        samples=int(np.clip(SAMPLES_PER_SEGMENT * path.segments + 1, MIN_SAMPLES, MAX_SAMPLES)),
        attributes={**(attributes or {}), **about},
        findings=findings,
    )
    dataset = dataset.assign(_sigmas(fitted, dataset, limits))
    names, texts = zip(*route_fact_rows(fitted), strict=True)
    coordinate = (ROUTE_FACT, list(names), {"long_name": "fact of the fit"})
    return dataset.assign_coords({ROUTE_FACT: coordinate}).assign(
        {ROUTE_FACT_TEXT: (ROUTE_FACT, list(texts), {"long_name": "fact of the fit, as text"})}
    )


def _sigmas(fitted: FittedRoute, dataset: xarray.Dataset, limits: Limits | None) -> dict[str, tuple]:
    """Return the standard deviations of variables along the fitted route, which is the first path."""
    if not fitted.information.size or np.isnan(np.asarray(fitted.position_sigma)):
        return {}
    vehicle = None if limits is None else limits.vehicle
    changes = vehicle is not None and vehicle.on_changing_road
    wanted = dict.fromkeys([*SIGMAS, *limited_variables(dataset)])
    names = [x for x in wanted if x in dataset and (x in VECTORS or _is_known(x, vehicle is not None and not changes))]
    times = np.clip(dataset["time"].values[0], 0.0, float(np.asarray(fitted.path.duration)))
    found = uncertainty(fitted, times, names, vehicle)
    variables = {}
    for name in names:
        values = np.full(dataset[name].shape, np.nan)
        values[0] = found.sigma[name]
        about = f"standard deviation of the fitted route, to first order: {dataset[name].attrs.get('long_name', name)}"
        units = {"units": dataset[name].attrs["units"], "long_name": about}
        variables[f"{name}_sigma"] = (dataset[name].dims, values, units)
    return variables


def _is_known(name: str, has_road: bool) -> bool:
    """Return whether a variable has a standard deviation; forces have none on a road that changes along the way."""
    return name in ENTRIES and (has_road or not ENTRIES[name].needs)
