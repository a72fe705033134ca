"""Floor 6: the command line, one file per command and a room for the work behind it."""
