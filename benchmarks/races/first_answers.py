"""Measure first calls: the processor time and the memory of functions and commands, each in a fresh process."""

from ..first_answers import measured
from . import Measured


def measure(quick):
    title = "First calls, each in a fresh process without any cache; functions without imports, commands with them"
    return Measured(title, measured(quick), {})
