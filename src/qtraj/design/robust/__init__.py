"""Tuning with margins, so that limits are satisfied with a probability although states and limits are uncertain."""
