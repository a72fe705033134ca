"""The work behind `qtraj report`."""
