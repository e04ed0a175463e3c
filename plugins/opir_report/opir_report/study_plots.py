"""Plots of a study: effects of what varies, and paired differences from the first design."""

from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes

from opir_report.canvas import STYLE, new_axes, plots_of
from opir_report.plots.effects import difference_plot, effect_plot
from opir_report.saved_study import read_study


class StudyPlots:
    """The plots of the study in a folder. Each method draws into `ax`, or into a new figure, and
    returns the axes.

    Raises `SceneError` for a folder without a study.
    """

    def __init__(self, folder: str | Path) -> None:
        self.study = read_study(Path(folder))

    def __repr__(self) -> str:
        """Return the names of the plots, which are methods."""
        return f"<StudyPlots: {plots_of(self)}>"

    def effect(self, figure: str, over: str | None = None, ax: Axes | None = None) -> Axes:
        """Draw the mean of a figure with its 95 % interval over the path `over`, by default that
        with most numbers.

        `KeyError` for a figure that the study does not have, or a path that does not vary.
        """
        if over is not None and over not in self.study.paths:
            raise KeyError(
                f"{over!r} does not vary in this study; {', '.join(self.study.paths)} do"
            )
        axes = new_axes(3.8) if ax is None else ax
        with rc_context(STYLE):
            return effect_plot(axes, self.study, figure, over)

    def difference(self, figure: str, ax: Axes | None = None) -> Axes:
        """Draw how much a figure of each design differs from the first one, paired over runs, with
        95 % intervals.
        """
        axes = new_axes(3.8) if ax is None else ax
        with rc_context(STYLE):
            return difference_plot(axes, self.study, figure)
