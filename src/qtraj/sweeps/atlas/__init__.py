"""Which points of a plane of two parameters are feasible, with the border between the classes to a tolerance."""
