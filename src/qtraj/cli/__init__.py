"""Layer 7: the command line, one file per command: load a scenario, run the library, show its results."""

BAD_INPUT = 2
"""Exit code of a run that refused its input."""

INTERRUPTED = 130
"""Exit code of a run that Ctrl-C ended."""
