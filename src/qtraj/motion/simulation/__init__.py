"""λ(t), ω(t) where the acceleration ε(t, λ, ω) is given: open loop, and the closed loop."""
