"""Change all joint states and durations of a route together so that the route satisfies its limits."""
