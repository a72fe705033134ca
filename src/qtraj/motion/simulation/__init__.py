"""Integrate λ(t) and ω(t) from an angular acceleration ε(t, λ, ω), in open loop and in closed loop."""
