"""Floor 6: files that other tools read and write."""
