"""The ideal geostationary slot, by its short name; all orbits are in `opir_core.orbits`."""

from opir_core.orbits.geostationary import GeostationaryOrbit as GeostationaryOrbit
