"""The work behind `qtraj tune`."""
