"""Change all joint states and durations of a route together, so that it satisfies its limits."""
