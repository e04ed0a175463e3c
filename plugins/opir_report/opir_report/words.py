"""Names of figures and settings as words with units, and the units and numbers that an axis
shows.
"""

import re

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray

#: Units at the end of names, longest first, as axes write them.
_UNITS = {
    "_pixels": "pixels",
    "_percent": "%",
    "_w_sr_um": "W/(sr µm)",
    "_w_sr": "W/sr",
    "_w_m2": "W/m²",
    "_bytes_s": "bytes/s",
    "_urad_s": "µrad/s",
    "_deg_s": "°/s",
    "_per_s": "per s",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_urad": "µrad",
    "_mrad": "mrad",
    "_rad": "rad",
    "_deg": "°",
    "_km2": "km²",
    "_km": "km",
    "_um": "µm",
    "_cm": "cm",
    "_ms": "ms",
    "_hz": "Hz",
    "_k": "K",
    "_m": "m",
    "_s": "s",
}
_WRITTEN = {"km2": "km²", "m2": "m²", "1/day": "per day", "1/h": "per hour"}
_ABBREVIATIONS = {
    "rmse": "RMSE",
    "snr": "SNR",
    "nees": "NEES",
    "gospa": "GOSPA",
    "fov": "field of view",
    "nei": "NEI",
    "p50": "median",
    "p90": "90th percentile",
}
#: Settings whose last word says too little.
_SETTINGS = {
    "sensors.count": "number of sensors",
    "sensors.keep": "sensors",
    "sensors.without": "sensors left out",
}
_INDEX = re.compile(r"\[([^]]*)\]")


@frozen
class ShownUnit:
    """The unit of an axis, and by how much values are divided for it."""

    unit: str
    divisor: float = 1.0


def shown_unit(unit: str, values: FloatArray) -> ShownUnit:
    """Return the unit in which an axis shows values (n,), so that it needs no offset such as
    1e6.
    """
    largest = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
    if unit == "m" and largest >= 1e4:
        return ShownUnit("km", 1e3)
    if unit == "m/s" and largest >= 1e4:
        return ShownUnit("km/s", 1e3)
    if unit in ("km2", "km²") and largest >= 1e6:
        return ShownUnit("million km²", 1e6)
    return ShownUnit(_WRITTEN.get(unit, unit))


def figure_words(figure: str, unit: str) -> str:
    """Return the name of a figure in words, without its unit: `impact area of the last
    estimate`.
    """
    ends = {"1/day": "_a_day", "m/s": "_m_s", "km²": "_km2"}
    words = _words(figure.removesuffix(ends.get(unit, f"_{unit}" if unit else "")))
    return re.sub(" last estimate$", " of the last estimate", words)


def axis_label(words: str, unit: str) -> str:
    """Return words with a unit, if there is one: `latency, s`."""
    return f"{words}, {unit}" if unit else words


def setting_words(path: str) -> tuple[str, str]:
    """Return the name of a setting in words, and its unit: `scan period` and `ms` of
    `sensors[*].scan_period_ms`.
    """
    if path in _SETTINGS:
        return _SETTINGS[path], ""
    *parents, key = path.split(".")
    item = _INDEX.search(key)
    name = _INDEX.sub("", key)
    unit = ""
    for end, written in _UNITS.items():
        if name.endswith(end) and name != end[1:]:
            name = name.removesuffix(end)
            unit = written
            break
    if name.isupper() and parents:  # a target class, as in detection_probability.ICBM
        return f"{setting_words('.'.join(parents))[0]} of {name}", unit
    words = _words(name)
    return (f"{words} {item[1]}" if item is not None and item[1] != "*" else words), unit


def level_words(path: str, label: str) -> str:
    """Return a value of a setting in words: `scan period 500 ms`, `tracker imm`."""
    return f"{setting_words(path)[0]} {level_value(path, label)}"


def level_value(path: str, label: str) -> str:
    """Return a value of a setting with its unit: `500 ms`, `-135°`, `imm`."""
    unit = setting_words(path)[1]
    return f"{label}{'' if unit in ('°', '') else ' '}{unit}"


def number_words(value: float, digits: int = 4) -> str:
    """Return a number to a few digits, as axes and tables write it: `0.25`, `12 500`; powers of ten
    beyond.
    """
    if not np.isfinite(value):
        return "-"
    short = float(f"{value:.{digits}g}")
    if 1e4 <= abs(short) < 1e7:
        return f"{short:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return (
        f"{short:.0f}" if 1e2 <= abs(short) < 1e4 and short.is_integer() else f"{short:.{digits}g}"
    )


def _words(name: str) -> str:
    return " ".join(_ABBREVIATIONS.get(word, word) for word in re.split("[_-]", name))
