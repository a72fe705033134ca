"""Layer 7: the command line, one file per command: load a scenario, run the library, show its results."""

BAD_INPUT = 2
"""Exit code of a run whose input is invalid."""

INTERRUPTED = 130
"""Exit code of a run that was interrupted by Ctrl-C."""
