"""Layer 6: curves without times in files: tables of points, GeoJSON, and GPX."""
