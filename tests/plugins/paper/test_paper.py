"""`opir paper`: every figure has a verdict, simulations reproduce formulas, and a wrong sensor is
found out.
"""

import json
import re
from typing import Any

import pytest
import yaml
from command_line import run_command
from opir_paper import checks, simulated
from opir_paper.printed import above, rounded
from opir_paper.simulated import Simulated

import opir_core as opir

#: The figures that contradict the paper's own formulas, by section:
#: docs/explanation/paper-errata.md.
CORRECTED = {"2.1": 1, "2.4": 1, "4.2": 1, "4.3": 1, "5.1": 2, "5.3": 1, "8.2": 1}


def verdicts(figures: Any, verdict: str) -> dict[str, int]:
    sections = [check.section for check in figures if check.verdict == verdict]
    return {section: sections.count(section) for section in sections}


def test_each_figure_holds_or_is_corrected_where_the_errata_say() -> None:
    figures = checks(5)
    assert len(figures) > 55
    assert verdicts(figures, "NOT REPRODUCED") == {}
    assert verdicts(figures, "corrected") == CORRECTED


def test_a_notional_level_corrects_nothing() -> None:
    assert verdicts(checks(5), "differs: notional") == {"2.3": 2}


def test_oblateness_and_drag_are_tested_each_and_together() -> None:
    """Drag, as the paper says, is more of a short range than of a long one; J2 by itself is not."""
    verdict_of = {
        check.quantity.partition(":")[0]: check.verdict
        for check in checks(5)
        if check.section == "5.3"
    }
    assert verdict_of == {"J2": "corrected", "drag": "holds", "J2 and drag": "holds"}


def test_a_ratio_of_printed_figures_that_is_rounded_holds() -> None:
    (latencies,) = [
        check for check in checks(5) if check.quantity.startswith("latency, DSP over SBIRS-GEO")
    ]
    assert (latencies.paper, latencies.formula, latencies.verdict) == ("2.6", "2.64", "holds")


def test_a_sensor_that_is_not_the_papers_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    right = simulated.scene

    def wrong(*arguments: Any, **settings: Any) -> dict[str, Any]:
        plain = dict(right(*arguments, **settings))
        plain["sensors"] = [
            {**sensor, "detection_probability": {"ICBM": 0.7}} for sensor in plain["sensors"]
        ]
        return plain

    for module in ("simulated", "figure_checks"):
        monkeypatch.setattr(f"opir_paper.{module}.scene", wrong)
    sections = verdicts(checks(5), "NOT REPRODUCED")
    assert sections["4.2"] >= 3  # shares of looks that detect
    assert sections["5.1"] >= 3  # latencies
    assert {"3.1", "3.2", "3.3"} <= set(sections)  # stated probabilities


def test_printed_figures_stand_for_what_rounds_to_them() -> None:
    assert rounded("0.125").covers(0.1254)
    assert not rounded("0.125").covers(0.1256)
    assert rounded("1500").covers(1500.4)
    assert not rounded("1500").covers(1501.0)
    assert not above("0.999999999").covers(0.9999998976)


@pytest.mark.parametrize(("hits", "trials"), [(0, 50), (50, 50), (7, 50)])
def test_the_interval_of_a_share_is_wilsons(hits: int, trials: int) -> None:
    """Its ends are where the observed share is 3.2905 standard deviations away."""
    share = Simulated.share(hits, trials)
    for end in (share.low, share.high):
        if 1e-9 < end < 1.0 - 1e-9:
            assert abs(hits / trials - end) == pytest.approx(
                3.2905 * (end * (1.0 - end) / trials) ** 0.5
            )
    assert share.holds(hits / trials)


def test_the_scene_that_is_printed_is_the_one_that_is_simulated(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run_command("paper --scene --seed 3")
    scene = opir.scene_from_mapping(yaml.safe_load(capsys.readouterr().out))
    assert scene == opir.scene_from_mapping(dict(simulated.scene(3)))


def test_plain_data_and_the_page_have_all_figures(capsys: pytest.CaptureFixture[str]) -> None:
    run_command("paper --json")
    plain = json.loads(capsys.readouterr().out)
    run_command("paper --html")
    page = capsys.readouterr().out
    assert len(re.findall("<tr class=", page)) == len(plain) > 40
    assert "](" not in page  # no links of Markdown
    assert page.count("<table>") == 2


def test_a_seed_out_of_range_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    run_command("paper --seed -1", code=2)
    assert "--seed" in capsys.readouterr().err
