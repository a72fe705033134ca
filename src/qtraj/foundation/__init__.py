"""The ground under the six floors: array types, input checks, stored documents."""
