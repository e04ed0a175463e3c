"""Work that no machine can do is refused before it is accepted, and a cycle of many looks is cut
into windows.
"""

from typing import Any

import pytest
from live_scene import LATER, batch, lines, mapping
from waiting import until

from opir_core.errors import SceneError
from opir_core.live import LiveRun, LiveSettings, LiveWindow, running
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


@pytest.mark.slow
def test_a_cycle_of_many_looks_is_cut_into_windows(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "LOOKS_PER_WINDOW", 10)
    scene = scene_from_mapping(mapping(), host=host)
    live_windows: list[LiveWindow] = []
    run = LiveRun(scene, host, LiveSettings(speed=None), live_windows.append)
    run.start()
    until(lambda: run.status().state == "ended")
    status = run.stop()
    assert status.error is None
    assert max(live.window.looks for live in live_windows) <= 10 + len(run.plan.pairs)
    assert len(live_windows) > status.cycle >= 100
    assert b"".join(lines(run.plan, live.window) for live in live_windows) == batch(scene, host)


def test_a_setting_above_the_limit_of_a_cycle_is_refused(host: Host) -> None:
    scene = scene_from_mapping(
        mapping(allow_implausible=True, limits={"looks_per_cycle": 1e5}), host=host
    )
    run = LiveRun(scene, host, LiveSettings())
    run.start()
    settings = run.settings_mapping()
    for period_ms, limit in ((1e-6, "run"), (1e-4, "cycle")):
        settings["sensors"][0]["members"][0]["scan_period_ms"] = period_ms
        with pytest.raises(
            SceneError, match=rf"limits\.looks_per_{limit}: .* lengthen scan_period_ms of DSP-1"
        ):
            run.configure(settings)
    settings["sensors"][0]["members"][0]["scan_period_ms"] = 50.0
    assert run.configure(settings) > 0
    assert run.stop().error is None


def test_limits_cannot_be_raised_while_a_scene_runs(host: Host) -> None:
    run = LiveRun(scene_from_mapping(mapping(), host=host), host, LiveSettings())
    run.start()
    with pytest.raises(Exception, match="limits: needs a restart"):
        run.configure(run.settings_mapping() | {"limits": {"looks_per_cycle": 1e12}})
    run.stop()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["looks_per_cycle", "events_per_cycle", "bytes_per_cycle"])
def test_a_launch_above_the_limit_of_a_cycle_is_refused(host: Host, name: str) -> None:
    def limited(limit: float, **changes: Any) -> LiveRun:
        scene = scene_from_mapping(mapping(limits={name: limit}, **changes), host=host)
        return LiveRun(scene, host, LiveSettings(speed=100.0))

    work = LiveRun(
        scene_from_mapping(mapping(), host=host), host, LiveSettings()
    ).plan.workload.of_cycle(5 * 10**9)
    enough = getattr(work, name.partition("_")[0])
    with pytest.raises(SceneError, match=rf"limits\.{name}: a cycle of 5 s of scene time has"):
        limited(enough - 1)
    run = limited(enough)
    run.start()
    for number in range(9):
        try:
            run.launch(LATER | {"id": f"N{number}", "launch": LATER["launch"] | {"time_s": 90.0}})
        except SceneError as refused:
            assert f"limits.{name}" in str(refused)  # noqa: PT017
            break
    else:
        pytest.fail("every launch was accepted")
    assert run.stop().error is None


def test_an_implausible_change_is_refused_unless_it_is_allowed(host: Host) -> None:
    run = LiveRun(scene_from_mapping(mapping(), host=host), host, LiveSettings())
    run.start()
    settings = run.settings_mapping()
    settings["sensors"][0]["members"][0]["line_of_sight_sigma_urad"] = 90_000.0
    with pytest.raises(SceneError, match=r"is outside the plausible .* urad; if it is meant"):
        run.configure(settings)
    run.configure({**settings, "allow_implausible": True})
    assert run.settings_mapping()["allow_implausible"] is True
    assert run.stop().error is None
