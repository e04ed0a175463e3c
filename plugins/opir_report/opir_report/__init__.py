"""Plots of a run with matplotlib, and reports of runs and studies as one HTML file.

Each name is imported when it is first used, so that a command that draws nothing does not import matplotlib.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_report.pages.run_report import write_run_report
    from opir_report.pages.study_report import write_study_report
    from opir_report.run_plots import RunPlots, map_svg
    from opir_report.study_plots import StudyPlots

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "run_plots": "RunPlots map_svg",
    "pages.run_report": "write_run_report",
    "pages.study_report": "write_study_report",
    "study_plots": "StudyPlots",
}

__all__ = ["RunPlots", "StudyPlots", "map_svg", "write_run_report", "write_study_report"]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_report.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_report' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
