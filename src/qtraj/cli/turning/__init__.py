"""The work behind `qtraj turn`."""
