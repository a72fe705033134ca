"""Scenarios are read and built as the command line does it for a user."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def unchecked(as_a_user_runs_it):
    """Without the checks of shapes."""
