"""Layer 6: files for the exchange of data with other tools."""
