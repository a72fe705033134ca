"""The fastest timing along a path whose shape is given, proved between the samples."""
