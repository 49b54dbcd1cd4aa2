"""Plants: helicopters, terrain, terrain sensor and wind."""
