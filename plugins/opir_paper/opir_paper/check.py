"""A figure of the paper beside what its formula gives and what opir simulates, with a verdict."""

from attrs import frozen

from opir_paper.printed import Printed, figure_text
from opir_paper.simulated import Simulated

#: Verdicts. The printed figure follows from the formulas, or rounds what does; formulas contradict
#: it; it is taken over as a default; a notional figure of opir's stands for it, which corrects
#: nothing; the simulation is not the formula.
HOLDS = "holds"
CORRECTED = "corrected"
TAKEN_OVER = "taken over"
NOTIONAL = "differs: notional"
NOT_REPRODUCED = "NOT REPRODUCED"

#: Scan period, ms, and P_d of an ICBM by sensor, as printed in sections 3.1 to 3.4, 4.1 and 4.2.
STATED = {"DSP": ("200", "0.60"), "SBIRS-GEO": ("100", "0.80"), "NEXTGEN-GEO": ("50", "0.95")}


@frozen
class Check:
    """A figure of the paper as texts: what is printed, what the formulas give, what is simulated,
    and a verdict.
    """

    section: str
    quantity: str
    paper: str
    formula: str
    simulated: str
    verdict: str

    def cells(self) -> tuple[str, ...]:
        """Return the texts in the order of a table."""
        return self.section, self.quantity, self.paper, self.formula, self.simulated, self.verdict


def checked(
    section: str,
    quantity: str,
    printed: Printed,
    value: float,
    unit: str = "",
    simulated: Simulated | None = None,
    digits: int = 4,
) -> Check:
    """Return the check of a printed figure against the value of its formula, and of that against a
    simulation.
    """
    verdict = HOLDS if printed.covers(value) else CORRECTED
    if simulated is not None and not simulated.holds(value):
        verdict = NOT_REPRODUCED
    unit = f" {unit}" if unit else ""
    text = "-" if simulated is None else figure_text(simulated, digits) + unit
    return Check(section, quantity, printed.text + unit, f"{value:.{digits}g}{unit}", text, verdict)
