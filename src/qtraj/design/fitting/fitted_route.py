"""The result of `fit_route`: the route, its residual and prediction error, outliers, stops and gaps."""

from __future__ import annotations

import math
import os

import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.fitting.route_covariance import covariances
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import extent
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.attitude_residual import AttitudeResidual
from qtraj.motion.rate_residual import RateResidual
from qtraj.path.residual import Residual
from qtraj.path.route import Route


@storable
class FittedRoute(AbstractOutcome):
    """The result of `fit_route`.

    - `path`: the `Route`; its time 0 is the time of the first sample.
    - `residual`: the differences between the route and the samples that are not outliers.
    - `prediction_error` [m]: the RMS distance of every second sample from a route that is fitted to the other samples.
    - `stretch_error` [m]: the RMS distance of the samples in held-out intervals from a route that is fitted to the
      other samples.
    - `smoothing` [s⁵]: the weight of ∫|r⃛|²dt, relative to the sum of squared distances.
    - `outliers` (k,): the indices of samples that are excluded from the fit.
    - `stops` (m, 2) [s]: the intervals of stops.
    - `gaps` (j, 2) [s]: the intervals without samples that are longer than four knot spacings and four time steps
      of the recording; the route bridges them with minimum jerk.
    - `position_sigma` [m]: the standard deviation of the position errors per axis. If standard deviations were given,
      it is the square root of the harmonic mean of their squares, and RMS distances of held-out samples are weighted.
    - `information` (6, 3 n): the diagonals of the normal matrix for n knots, in units of position_sigma^-2;
      (3, 6, 3 n) if the standard deviations of x, y and z differ. `covariance` uses them.
    - `penalty`: the part of `information` that the smoothing adds; zero in older documents.
    - `smoothing_errors` (n, 3, 3): the expected errors of position [m], velocity [m/s] and acceleration [m/s²] at the
      knots by the smoothing; None in older documents.
    - `knots` (n,) [s]: the times of these knots. They are the joints of the route, except next to stops (see
      `fit_route`).
    - `attitude`: for a recording with attitudes, their difference from the upright frame of the route, and the mounting
      of the recorder relative to this frame; otherwise None.
    - `rates`: for a recording with angular rates, their difference from the rates of the upright frame of the route,
      at speeds above 3 m/s; otherwise None.
    """

    path: Route
    residual: Residual
    prediction_error: Scalar
    stretch_error: Scalar
    smoothing: Scalar
    outliers: Int[Array, " k"]
    stops: Float[Array, "m 2"]
    gaps: Float[Array, "j 2"]
    position_sigma: Scalar
    information: Float[Array, "*axes 6 unknowns"]
    code: Int[Array, ""]
    attitude: AttitudeResidual | None
    rates: RateResidual | None
    knots: Float[Array, " n"]
    penalty: Float[Array, "*axes 6 unknowns"]
    smoothing_errors: Float[Array, "n 3 3"] | None

    def __init__(
        self,
        path: Route,
        residual: Residual,
        prediction_error: ArrayInput,
        stretch_error: ArrayInput = math.nan,
        smoothing: ArrayInput = math.nan,
        outliers: ArrayInput = (),
        stops: ArrayInput = (),
        gaps: ArrayInput = (),
        position_sigma: ArrayInput = math.nan,
        information: ArrayInput = (),
        code: ArrayInput = ResultCode.successful,
        attitude: AttitudeResidual | None = None,
        rates: RateResidual | None = None,
        knots: ArrayInput | None = None,
        penalty: ArrayInput | None = None,
        smoothing_errors: ArrayInput | None = None,
    ):
        self.path, self.residual, self.attitude, self.rates = path, residual, attitude, rates
        self.prediction_error, self.stretch_error = as_float(prediction_error), as_float(stretch_error)
        self.smoothing, self.position_sigma = as_float(smoothing), as_float(position_sigma)
        self.outliers = as_array(np.reshape(np.asarray(outliers, int), -1), int)
        self.stops, self.gaps = (as_float(np.reshape(np.asarray(x, float), (-1, 2))) for x in (stops, gaps))
        diagonals = np.asarray(information, float)
        self.information = as_float(diagonals if diagonals.ndim == 3 else diagonals.reshape(6, -1))
        self.code = as_array(int(np.asarray(code)), np.int32)
        self.knots = path.times if knots is None else as_float(knots)
        self.penalty = 0.0 * self.information if penalty is None else as_float(penalty)
        self.smoothing_errors = None if smoothing_errors is None else as_float(smoothing_errors)

    def covariance(self) -> Float[np.ndarray, "*axes n 3 3"]:
        """Return the covariance of position, velocity and acceleration at each of the n knots, in SI units.

        The covariance is the same for x, y and z, unless the fit had a standard deviation for each component. In
        that case the result has the shape (3, n, 3, 3), with a covariance for each axis. The errors are assumed to be
        independent. If the errors of k successive samples are correlated, the true covariance is about k times larger.
        At the ends of a stop the fitted velocity and acceleration are exactly zero, and their covariance is negligible.
        The smoothing counts as a prior distribution of the motion, which makes the covariance of the accelerations too
        large for most drives; `qtraj.uncertainty` computes the effect of the errors of the samples alone.
        """
        sigma = float(np.asarray(self.position_sigma))
        return sigma**2 * covariances(np.asarray(self.information, float))

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result, with the errors, outliers and gaps."""
        code = ResultCode(int(np.asarray(self.code)))
        if code != ResultCode.successful:
            return code.text
        rms, prediction = float(self.residual.distance_rms), float(self.prediction_error)
        held_out = f"; the RMS distance of held-out samples (cross-validation) is {prediction:.3g} m"
        known = held_out if np.isfinite(prediction) else ", which consists of waypoints"
        texts = [f"{self.path.segments} segments fit the recording with an RMS distance of {rms:.3g} m{known}."]
        if len(self.outliers):
            texts.append(f"Outliers excluded from the fit: {len(self.outliers)}.")
        if len(self.gaps):
            longest = float(np.max(np.diff(np.asarray(self.gaps), axis=1)))
            texts.append(
                f"Gaps in the recording: {len(self.gaps)}, bridged with minimum jerk; the longest lasts "
                f"{longest:.3g} s."
            )
        return " ".join(texts)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file, without loss of precision; `qtraj.load` reads it."""
        document.save(self, file)

    def record(self) -> Record:
        """Return the variables of the route, of the residual (with the prefix `residual_`), and of the fit."""
        path, residual = self.path.record(), self.residual.record()
        variables = {
            **path.variables,
            **{f"residual_{name}": quantity for name, quantity in residual.variables.items()},
            "prediction_error": Quantity(
                self.prediction_error, "m", "RMS distance at held-out samples (every second one)"
            ),
            "stretch_error": Quantity(self.stretch_error, "m", "RMS distance in held-out intervals"),
            "smoothing": Quantity(self.smoothing, "s5", "weight of the squared jerk"),
            "position_sigma": Quantity(self.position_sigma, "m", "standard deviation of the position errors per axis"),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
        }
        if len(self.outliers):
            variables["outlier"] = Quantity(
                self.outliers, "1", "index of a sample excluded from the fit", ("outlier_",)
            )
        for name, meaning in (("stops", "intervals of stops"), ("gaps", "intervals without samples")):
            if len(getattr(self, name)):
                variables[name] = Quantity(getattr(self, name), "s", meaning, (name[:-1], "bound"))
        if self.attitude is not None:
            attitude = self.attitude.record().variables
            variables |= {f"attitude_{name}": quantity for name, quantity in attitude.items()}
        if self.rates is not None:
            variables |= {f"rate_{name}": quantity for name, quantity in self.rates.record().variables.items()}
        counts = f"{len(self.stops)} stops, {len(self.outliers)} outliers"
        rms = f"RMS {extent(self.residual.distance_rms, 'm')}, predicted {extent(self.prediction_error, 'm')}"
        return Record(f"{self.path.segments} segments: {rms}; {counts}", variables, attributes={"frame": "world"})
