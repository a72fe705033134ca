"""Fit spiral-helices and routes to recordings."""
