"""Parameter studies: sweeps over scenes, metrics with intervals, executors, comparison of trackers."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_studies.executors import LostTasksError
    from opir_studies.result import StudyResult, load_study
    from opir_studies.study import Study, read_study
    from opir_studies.sweeping import StudyError, StudyProgress, sweep
    from opir_studies.tuning import Tuned, tune

__all__ = [
    "LostTasksError",
    "Study",
    "StudyError",
    "StudyProgress",
    "StudyResult",
    "Tuned",
    "load_study",
    "read_study",
    "sweep",
    "tune",
]

#: The module of each name, imported on first use, so that discovering the plugin imports neither NumPy nor pyarrow.
_HOMES = {
    "LostTasksError": "executors",
    "Study": "study",
    "StudyError": "sweeping",
    "StudyProgress": "sweeping",
    "StudyResult": "result",
    "Tuned": "tuning",
    "load_study": "result",
    "read_study": "study",
    "sweep": "sweeping",
    "tune": "tuning",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"opir_studies.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
