"""Colours of plots: the colour-blind safe series of Okabe and Ito, and one colour for each role,
light and dark.

Plots are drawn in the light colours. Each is distinct, so that a page can exchange it for a CSS
variable that has another value in dark mode.

Source: Okabe and Ito, Color Universal Design (2008); the dark values are the same hues, lighter.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from attrs import frozen

INK = "#1a1c20"
MUTED = "#5c6069"
PAPER = "#fffffe"
GRID = "#dfe1e6"
LAND = "#ebe7dd"
SEA = "#f4f7fb"
COAST = "#b3ad9f"

#: Series, most distinct first: blue, vermilion, bluish green, reddish purple, orange, sky blue.
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")

#: The name of each colour, and its value in dark mode.
ROLES: Mapping[str, tuple[str, str]] = {
    INK: ("ink", "#eceef2"),
    MUTED: ("muted", "#a6abb5"),
    PAPER: ("paper", "#16181c"),
    GRID: ("grid", "#353941"),
    LAND: ("land", "#2c2e2b"),
    SEA: ("sea", "#191d24"),
    COAST: ("coast", "#66665e"),
    SERIES[0]: ("s1", "#4fa8e0"),
    SERIES[1]: ("s2", "#ff8b3d"),
    SERIES[2]: ("s3", "#2fcf9f"),
    SERIES[3]: ("s4", "#e39bc4"),
    SERIES[4]: ("s5", "#f2bd3f"),
    SERIES[5]: ("s6", "#9bd6fb"),
}

#: Line styles of the series, so that they differ in print without colour too.
DASHES = (
    "-",
    (0, (5, 1.5)),
    (0, (1.5, 1.2)),
    (0, (6, 1.5, 1.5, 1.5)),
    (0, (3, 1)),
    (0, (8, 2, 1.5, 2, 1.5, 2)),
)


@frozen
class Hue:
    """The colour and the line style of a series, and its name in a legend."""

    colour: str
    dashes: Any
    label: str

    @property
    def style(self) -> dict[str, Any]:
        """The style of a line."""
        return {"color": self.colour, "linestyle": self.dashes}


@frozen
class Hues:
    """The hues of targets: one each for a few of them, one for each type where there are many."""

    of_target: tuple[Hue, ...]
    legend: tuple[Hue, ...]

    @classmethod
    def of(cls, ids: Sequence[str], types: Sequence[str]) -> "Hues":
        """Return the hues of targets with ids (n,) and types (n,)."""
        names = list(types)
        labels = list(dict.fromkeys(types))
        if len(ids) <= len(SERIES):
            names = list(ids)
            labels = [f"{target} ({kind})" for target, kind in zip(ids, types, strict=True)]
        hues = {
            name: series_hue(number, labels[number])
            for number, name in enumerate(dict.fromkeys(names))
        }
        return cls(tuple(hues[name] for name in names), tuple(hues.values()))


def series_hue(number: int, label: str) -> Hue:
    """Return the hue of a series by its number; after the last colour they begin anew, with other
    dashes.
    """
    place = number % len(SERIES)
    turn = number // len(SERIES)
    return Hue(SERIES[place], DASHES[(place + 2 * turn) % len(DASHES)], label)
