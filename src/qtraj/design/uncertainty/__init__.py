"""Standard deviations of quantities and margins along fitted paths."""
