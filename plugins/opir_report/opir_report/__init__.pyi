from opir_report.canvas import (
    STYLE as STYLE,
    svg_of as svg_of,
)
from opir_report.maps.base_map import (
    coast_rings as coast_rings,
)
from opir_report.maps.projections import (
    equal_earth as equal_earth,
)
from opir_report.pages.html_page import (
    html_page as html_page,
)
from opir_report.pages.run_report import (
    write_run_report as write_run_report,
)
from opir_report.pages.study_report import (
    write_study_figures as write_study_figures,
    write_study_report as write_study_report,
)
from opir_report.palette import (
    DASHES as DASHES,
    GRID as GRID,
    INK as INK,
    MUTED as MUTED,
    SERIES as SERIES,
)
from opir_report.run_plots import (
    RunPlots as RunPlots,
    map_svg as map_svg,
)
from opir_report.study_plots import (
    StudyPlots as StudyPlots,
)
