"""The fastest timing along a path of given shape, with proofs that limits are satisfied between the samples."""
