from opir_report.pages.run_report import (
    write_run_report as write_run_report,
)
from opir_report.pages.study_report import (
    write_study_report as write_study_report,
)
from opir_report.run_plots import (
    RunPlots as RunPlots,
    map_svg as map_svg,
)
from opir_report.study_plots import (
    StudyPlots as StudyPlots,
)
