"""The `HEO` sensor model and its default constellations: scanners in highly elliptical orbits."""
