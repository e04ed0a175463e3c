"""The figures of the paper, one by one: as printed, by the paper's own formulas, and as opir simulates them now."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from opir_photons.detection import cumulative_probability, latency_mean, latency_quantile

import opir_core as opir
from opir_core.plugin import Sensor
from opir_paper.arcs import j2_shifts_km
from opir_paper.printed import Printed, about, above, below, between, figure_text, rounded
from opir_paper.simulated import SENSORS, BoostCounts, Simulated, boost_counts, first_scans, scene

#: Of a check: the printed figure follows from the formulas; it does not; it is taken over as a default.
HOLDS, CORRECTED, TAKEN_OVER, NOT_REPRODUCED = "holds", "corrected", "taken over", "NOT REPRODUCED"

#: Sections 2.4 and 5.1: range of the minimum intensity, m, and its threshold; short names of sensors in the tables.
_RANGE_M, _SNR = 3.6e7, 5.0

_LATENCIES = {"DSP": ("0.33", "0.80"), "SBIRS-GEO": ("0.125", "0.30"), "NEXTGEN-GEO": ("0.053", "0.13")}
_LOOKS = {"DSP": "1500", "SBIRS-GEO": "3000", "NEXTGEN-GEO": "6000"}
_STATED = {"DSP": ("200", "0.60"), "SBIRS-GEO": ("100", "0.80"), "NEXTGEN-GEO": ("50", "0.95")}
_BANDS = {"DSP": "LWIR", "SBIRS-GEO": "SWIR, MWIR", "NEXTGEN-GEO": "SWIR, MWIR, LWIR"}
_WORDS = {
    "DSP": "high, none",
    "SBIRS-GEO": "moderate, dual band ratio",
    "NEXTGEN-GEO": "low, triple coincidence",
}


@frozen
class Check:
    """A figure of the paper as texts: what is printed, what the formulas give, what is simulated, and a verdict."""

    section: str
    quantity: str
    paper: str
    formula: str
    simulated: str
    verdict: str

    def cells(self) -> tuple[str, str, str, str, str, str]:
        """Return the texts in the order of a table."""
        return self.section, self.quantity, self.paper, self.formula, self.simulated, self.verdict


def _checked(
    section: str,
    quantity: str,
    printed: Printed,
    value: float,
    unit: str = "",
    simulated: Simulated | None = None,
    digits: int = 4,
) -> Check:
    """Return the check of a printed figure against the value of its formula, and of that against a simulation."""
    verdict = HOLDS if printed.covers(value) else CORRECTED
    if simulated is not None and not simulated.holds(value):
        verdict = NOT_REPRODUCED
    unit = f" {unit}" if unit else ""
    text = "-" if simulated is None else figure_text(simulated, digits) + unit
    return Check(section, quantity, printed.text + unit, f"{value:.{digits}g}{unit}", text, verdict)


def checks(seed: int = 1) -> Sequence[Check]:
    """Return the checks of the paper's figures, in its order; simulations have this seed.

    >>> from opir_paper import checks
    >>> sorted({check.verdict for check in checks()})
    ['corrected', 'holds', 'taken over']
    """
    scans, counts = first_scans(seed), boost_counts(seed)
    sensors = dict(zip(SENSORS, opir.compile_plan(opir.scene_from_mapping(scene(seed))).sensors, strict=True))
    return [
        *_intensities(),
        *_stated(sensors),
        *_looks(counts),
        *_cumulative(scans),
        *_confidences(counts),
        *_latencies(scans),
        *_impacts(),
        *_validation(sensors),
    ]


def _intensities() -> Iterator[Check]:
    """Yield the least intensity of section 2.4 for both units of the NEI."""
    for unit, nei_w_m2 in (("W/cm²", 5e-14 * 1e4), ("W/m²", 5e-14)):
        least = nei_w_m2 * _RANGE_M**2 * _SNR
        yield _checked("2.4", f"least intensity, NEI 5e-14 {unit}", about("300", 0.1), least, "W/sr", digits=3)


def _stated(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the sensors' parameters (3.1 to 3.4, 6.3), which are the defaults of the packages."""
    for number, (name, sensor) in enumerate(sensors.items(), 1):
        period_ms, probability = _STATED[name]
        rows = (
            ("bands", _BANDS[name], ", ".join(band.name for band in sensor.bands)),
            ("scan period, ms", period_ms, f"{sensor.scan.period_ns * 1e-6:g}"),
            ("P_d, ICBM", probability, f"{sensor.detection_probability['ICBM']:.2f}"),
            ("false alarm rate, discrimination", _WORDS[name], _words(sensor)),
        )
        for what, paper, ours in rows:
            verdict = TAKEN_OVER if paper == ours else NOT_REPRODUCED
            yield Check(f"3.{number}", f"{name}: {what}", paper, ours, "-", verdict)


def _words(sensor: Sensor) -> str:
    return f"{sensor.false_alarm_susceptibility}, {sensor.spectral_discrimination}".replace("-", " ")


def _looks(counts: BoostCounts) -> Iterator[Check]:
    for name in SENSORS:
        looks = counts.looks[name]
        planned = Simulated(looks, looks, looks)
        formula = 300.0 / (float(_STATED[name][0]) * 1e-3)
        yield _checked("4.1", f"{name}: looks in a boost of 300 s", rounded(_LOOKS[name]), formula, simulated=planned)
    for name in SENSORS:
        printed = _STATED[name][1]
        yield _checked("4.2", f"{name}: P_d of a look", rounded(printed), float(printed), "", counts.detected[name])


def _cumulative(scans: Mapping[str, np.ndarray]) -> Iterator[Check]:
    """Yield the probabilities of a detection within some looks."""
    rows: tuple[tuple[str, str, str, int, Printed], ...] = (
        ("4.2", "DSP", "1 s", 5, rounded("0.98976")),
        ("4.2", "SBIRS-GEO", "1 s", 10, above("0.999999999")),
        ("9", "NEXTGEN-GEO", "0.1 s", 2, above("0.99", text='"near-certain"')),
    )
    for section, name, time, looks, printed in rows:
        chance = float(cumulative_probability(float(_STATED[name][1]), looks))
        seen = Simulated.share(int((scans[name] <= looks).sum()), len(scans[name]))
        quantity = f"{name}: P(detected) within {time}, {looks} looks"
        yield _checked(section, quantity, printed, chance, "", seen, digits=10)


def _confidences(counts: BoostCounts) -> Iterator[Check]:
    """Yield the confidence at its edges: its count term as printed, and as bounded."""
    inside = between("in [0, 1]", 0.0, 1.0)
    yield _checked("4.3", "count term log10(1 + n), n = 9", inside, float(np.log10(10.0)))
    yield _checked("4.3", "count term log10(1 + n), n = 1500", inside, float(np.log10(1501.0)))
    for name in SENSORS:
        first, most = counts.confidence[name]
        quantity = f"{name}: confidence, first and largest of a boost"
        verdict = HOLDS if 0.0 <= first <= most <= 1.0 else NOT_REPRODUCED
        yield Check("4.3", quantity, inside.text, "count term at most 1", f"{first:.3f}, {most:.3f}", verdict)


def _latencies(scans: Mapping[str, np.ndarray]) -> Iterator[Check]:
    for place, what in enumerate(("mean", "95th percentile")):
        for name in SENSORS:
            period_s, chance = float(_STATED[name][0]) * 1e-3, float(_STATED[name][1])
            latency_s = scans[name] * period_s
            if place == 0:
                value, seen = float(latency_mean(period_s, chance)), Simulated.mean(latency_s)
            else:
                value, seen = float(latency_quantile(0.95, period_s, chance)), _quantile(scans[name], period_s)
            yield _checked("5.1", f"{name}: {what} latency", rounded(_LATENCIES[name][place]), value, "s", seen)


def _quantile(scans: np.ndarray, period_s: float) -> Simulated:
    """Return the 95th percentile of latencies and, from the binomial law of ranks, its interval."""
    ordered, count = np.sort(scans) * period_s, len(scans)
    half = 3.2905 * (0.95 * 0.05 * count) ** 0.5
    low, middle, high = (min(int(np.ceil(0.95 * count + shift)), count) - 1 for shift in (-half, 0.0, half))
    return Simulated(*(float(ordered[rank]) for rank in (middle, low, high)))


def _impacts() -> Iterator[Check]:
    """Yield the law of the impact's σ (5.2), and what J2 does to an arc (5.3)."""
    law: Any = opir.scene_from_mapping({**scene(1), "tracker": "kepler-arc"}).tracker.config
    for when, share, printed in (
        ("early", 0.0, between('"hundreds"', 100.0, 1000.0)),
        ("at mid-boost", 0.5, between('"tens"', 10.0, 100.0)),
    ):
        sigma_km = 1e-3 * law.sigma_0_m * float(np.exp(-law.convergence * share))
        yield _checked("5.2", f"σ of the impact {when}, k = {law.convergence:g}", printed, sigma_km, "km", digits=3)
    far_km, near_km = j2_shifts_km()
    yield _checked(
        "5.3",
        f"J2 moves an impact by {far_km:.3g} km at 9 000 km range, {near_km:.2g} km at 500 km: ratio",
        below("1", text='"second-order" far, "significant" near'),
        far_km / near_km,
        digits=3,
    )


def _validation(sensors: Mapping[str, Sensor]) -> Iterator[Check]:
    """Yield the ratios of sections 8 and 9."""
    period = {name: sensor.scan.period_ns * 1e-9 for name, sensor in sensors.items()}
    chance = {name: float(sensor.detection_probability["ICBM"]) for name, sensor in sensors.items()}
    mean_s = {name: period[name] / chance[name] for name in SENSORS}
    dsp, sbirs, nextgen = SENSORS
    yield _checked(
        "8.1",
        "DSP: mean latency with a ground chain of 20 to 50 s",
        between("30 to 60", 30.0, 60.0),
        35.0 + mean_s[dsp],
        "s",
    )
    yield _checked("8.2", "SBIRS-GEO: mean latency", Printed("0.000125", 1.245e-4, 1.255e-4), mean_s[sbirs], "s")
    yield _checked(
        "8.2", "P_d, SBIRS-GEO over DSP", rounded("33"), 100.0 * (chance[sbirs] / chance[dsp] - 1.0), "%", digits=3
    )
    yield _checked("8.2", "latency, DSP over SBIRS-GEO", rounded("2.6"), mean_s[dsp] / mean_s[sbirs], digits=3)
    yield _checked(
        "8.3",
        "P_d, NEXTGEN-GEO over SBIRS-GEO",
        rounded("19"),
        100.0 * (chance[nextgen] / chance[sbirs] - 1.0),
        "%",
        digits=3,
    )
    yield _checked("8.3", "scan rate, NEXTGEN-GEO over SBIRS-GEO", rounded("2"), period[sbirs] / period[nextgen])
    yield _checked(
        "8.3",
        "bands, NEXTGEN-GEO over SBIRS-GEO",
        rounded("50"),
        100.0 * (len(sensors[nextgen].bands) / len(sensors[sbirs].bands) - 1.0),
        "%",
    )
    yield _checked("9", "scan rate, NEXTGEN-GEO over DSP", rounded("4"), period[dsp] / period[nextgen])
