"""The `NEXTGEN-GEO` sensor model and its default constellation."""
