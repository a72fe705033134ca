"""The work behind `qtraj track`."""
