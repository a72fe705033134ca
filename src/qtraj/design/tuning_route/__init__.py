"""Routes changed so that their limits are satisfied: all joint states and durations together."""
