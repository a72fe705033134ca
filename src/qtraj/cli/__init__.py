"""Floor 6: the command line, one file per command and a room for the work behind it."""

BAD_INPUT = 2
"""Exit code of a run that refused what it was given."""

INTERRUPTED = 130
"""Exit code of a run that Ctrl-C ended."""
