"""Layer 5: sweeps: functions at many points, on Dask, in stores that can be resumed."""

from qtraj.sweeps.distributions import Column, Normal, Uniform

__all__ = ["Column", "Normal", "Uniform"]
