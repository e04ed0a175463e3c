"""The `SBIRS-GEO` sensor model and its default constellation: a two-band step-starer."""
