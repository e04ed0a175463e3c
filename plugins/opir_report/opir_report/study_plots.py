"""Plots of a study: effects of what varies, and paired differences from the first design."""

from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from opir_report.canvas import STYLE, WIDTH_IN, Plots, new_axes, new_layout
from opir_report.plots.effects import difference_plot, effect_plot
from opir_report.plots.share_curves import curves_figure
from opir_report.saved_study import read_study


class StudyPlots(Plots):
    """The plots of the study in a folder. Each method draws into `ax`, or into a new figure, and
    returns the axes.

    Raises `SceneError` for a folder without a study.
    """

    def __init__(self, folder: str | Path) -> None:
        self.study = read_study(Path(folder))

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

    def shares(self, column: str) -> Figure:
        """Return a new figure of the share of launches by a time, for a column of times of launches
        such as `detected_s`: a curve for each design, a panel for each condition.

        `KeyError` for a column that the launches do not have.
        """
        from matplotlib import pyplot

        units = self.study.definition.get("launches", {})
        times = [name for name, unit in units.items() if unit == "s"]
        if column not in times:
            raise KeyError(f"{column!r} is no time of launches; {', '.join(times) or 'none'} are")
        with rc_context(STYLE):
            figure = pyplot.figure(figsize=(WIDTH_IN, 3.8), layout=new_layout())
            curves_figure(figure, self.study, column)
        return figure
