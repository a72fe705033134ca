"""Recorded windows fitted by spiral-helices."""
