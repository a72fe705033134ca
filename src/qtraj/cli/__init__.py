"""Layer 7, the command line: each command has a module that reads a scenario, runs the library and prints results."""

BAD_INPUT = 2
"""Exit code of a run whose input is invalid."""

INTERRUPTED = 130
"""Exit code of a run that was interrupted by Ctrl-C."""
