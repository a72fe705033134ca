"""Layer 0: array types, input checks, stored documents, results and records."""
