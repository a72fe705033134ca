"""The work behind `qtraj evaluate`."""
