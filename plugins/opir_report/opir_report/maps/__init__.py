"""Maps: projections, coastlines and graticules."""
