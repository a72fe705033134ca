"""Layer 5: sweeps: functions at many points, on Dask, in stores that can be resumed."""

from qtraj.sweeps.distributions import Column, Normal, Uniform
from qtraj.sweeps.ready import certify, evaluate, retime, simulate, tune, tune_route

__all__ = ["Column", "Normal", "Uniform", "certify", "evaluate", "retime", "simulate", "tune", "tune_route"]
