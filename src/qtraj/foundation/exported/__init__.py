"""Traced programs, kept in a folder from one process to the next."""
