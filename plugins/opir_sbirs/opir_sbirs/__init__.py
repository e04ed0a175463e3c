"""The `SBIRS-GEO` sensor model and its default constellation."""
