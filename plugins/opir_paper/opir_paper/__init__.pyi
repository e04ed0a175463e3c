from opir_paper.check import Check as Check
from opir_paper.errata import (
    errata_page as errata_page,
    figures_page as figures_page,
)
from opir_paper.figure_checks import checks as checks
