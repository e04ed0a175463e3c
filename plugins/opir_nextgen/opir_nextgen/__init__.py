"""The `NEXTGEN-GEO` sensor model and its default constellation: a three-band staring array."""
