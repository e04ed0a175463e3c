"""Where satellites are: geosynchronous slots, Kepler elements, Molniya, circular orbits, Walker
patterns, TLE and OMM.

And when they are in the Earth's shadow or look towards the Sun.

Each name is imported when it is first used. Configurations and elements import no numpy, so that
plugins may name orbits in their catalogues.
"""

from opir_core.doors import door

__getattr__, __dir__, __all__ = door(__spec__)
