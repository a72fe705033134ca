"""λ(t) where the rate ω(t) is known."""
