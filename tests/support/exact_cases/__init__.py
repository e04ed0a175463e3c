"""Cases of every public function that takes numbers, with references in 40 digits; what is left
out, and why.
"""

from exact_cases import chain, detection, estimation, flight, geometry, radiometry


def every_case():
    """Return the cases of all functions."""
    return [
        case
        for module in (geometry, flight, radiometry, detection, estimation, chain)
        for case in module.CASES
    ]


def every_bound():
    """Return the searches of functions with a stated bound."""
    return [*geometry.BOUNDS, *flight.BOUNDS, *radiometry.BOUNDS]


def left_out():
    """Return the reasons for public names without a case, by package and name."""
    by_package = {
        "geometry": geometry.LEFT_OUT,
        "radiometry": radiometry.LEFT_OUT,
        **flight.LEFT_OUT,
        **detection.LEFT_OUT,
    }
    return {
        f"{package}.{name}": reason
        for package, names in by_package.items()
        for name, reason in names.items()
    }
