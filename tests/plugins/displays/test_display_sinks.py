"""The sinks `cot` and `dis`: from the command line and from Python, their datagrams, bad settings."""

import errno
from collections.abc import Mapping
from typing import Any, ClassVar
from unittest.mock import Mock

import numpy as np
import pytest
from command_line import main, run_command
from opir_testing import SinkContract
from repository import EXAMPLES
from udp_display import heard, listening, opened, port_of, sent, tracked

from opir_core import SinkError, compile_plan
from opir_core.output import deliver
from opir_core.reading import load_scene

SCENE = str(EXAMPLES / "first_light.yaml")
STATE = [6.4e6, 0.0, 0.0, 0.0, 1000.0, 0.0]


class TestCot(SinkContract):
    name = "cot"


class TestCotFile(SinkContract):
    name = "cot"
    settings: ClassVar[Mapping[str, Any]] = {"file": "tracks.cot"}


class TestDis(SinkContract):
    name = "dis"


def outputs(*blocks: str) -> list[str]:
    return ["duration_s=40", "tracker=kepler-arc", f"outputs=[{', '.join(blocks)}]"]


@pytest.mark.slow
def test_tracks_are_sent_from_the_command_line_and_from_python(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with listening() as display:
        words = (
            f"--tracker kepler-arc --set duration_s=40 --set outputs[0].dis.port={port_of(display)}"
        )
        run_command(f"run {{}} --sink dis {words} --set outputs[0].dis.threshold_m=1e6", SCENE)
        dis = f"{{dis: {{port: {port_of(display)}, threshold_m: 1e6}}}}"
        blocks = outputs("{cot: {file: tracks.cot}}", dis)
        outcome = deliver(compile_plan(load_scene(SCENE, overrides=blocks)))
        cot, dis = outcome.report.sinks
        assert f"dis: {dis.delivered} events" in capsys.readouterr().out
        assert cot.delivered == dis.delivered + dis.withheld > dis.delivered > 0
        assert heard(display, dis.delivered) == heard(display, dis.delivered)
    events = (tmp_path / "tracks.cot").read_text(encoding="utf-8").splitlines()
    assert len(events) >= cot.delivered
    assert all(line.startswith("<event ") and line.endswith("</event>") for line in events)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("host=''", "host: '' is no IP address; give one, such as 127.0.0.1"),
        ("host=display", "host: 'display' is no IP address; give one, such as 127.0.0.1"),
        ("host=192.0.2.7", "host 192.0.2.7 is not this machine; set allow_remote: true"),
        ("host=0.0.0.0", "host 0.0.0.0 is not this machine; set allow_remote: true"),
        ("port=0", "port: 0 is outside [1, 65535]"),
        ("port=65536", "port: 65536 is outside [1, 65535]"),
        ("prot=4242", "prot: unknown key; did you mean port?"),
    ],
)
@pytest.mark.parametrize("sink", ["cot", "dis"])
def test_a_bad_setting_is_one_clear_message(capsys, sink, setting, message):
    words = ["run", SCENE, "--quiet", "--sink", sink, "--set", f"outputs[0].{sink}.{setting}"]
    assert main(words) == 2
    reported = capsys.readouterr().err
    assert "1 problem" in reported
    assert message in reported


def test_an_address_beyond_this_machine_is_a_setting():
    opened("dis", host="192.0.2.7", allow_remote=True).close()


def test_a_display_has_no_spool(tmp_path):
    spool = f"{{dis: {{spool: {{path: {tmp_path / 'waiting.spool'}}}}}}}"
    with pytest.raises(SinkError, match=r"a display acknowledges nothing.*remove spool"):
        deliver(compile_plan(load_scene(SCENE, overrides=outputs(spool))))


class Clock:
    """A clock that only waiting moves on, and how long was waited."""

    now_s = 100.0

    def monotonic(self):
        return self.now_s

    def sleep(self, wait_s):
        self.now_s += wait_s


def test_datagrams_wait_for_their_turn_and_those_without_one_are_dropped_and_counted(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("opir_displays.display_sink.time", clock)
    window = tracked(50, track=np.arange(50), tick_s=0.0, state=STATE, end_s=1.0)
    datagrams, delivery = sent("dis", [window], rate_per_s=2.0)
    assert clock.now_s == pytest.approx(120.0)
    assert len(datagrams) == delivery.delivered == 41
    assert delivery.dropped == 9
    assert delivery.complaint.endswith(": 9 tracks are over rate_per_s; raise it")
    clock.now_s += 60.0
    datagrams, delivery = sent("dis", [window], rate_per_s=10.0)
    assert clock.now_s == pytest.approx(184.9)
    assert len(datagrams) == 50
    assert delivery.complaint is None


def test_nothing_waits_beyond_the_time_at_which_the_sink_must_be_closed(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("opir_displays.display_sink.time", clock)
    with listening() as display:
        sink = opened("dis", port=port_of(display), rate_per_s=1.0)
        sink.close_by(103.5)
        sink.write(tracked(9, track=np.arange(9), tick_s=0.0, state=STATE, end_s=1.0))
        assert sink.delivery_so_far().delivered == 4
        assert sink.close().dropped == 5
        assert clock.now_s == pytest.approx(103.0)


def test_what_the_system_refuses_fails_the_output(monkeypatch):
    monkeypatch.setattr(
        "opir_displays.entity_states.EntityStates._pdu", lambda *_, **__: b"-" * 70_000
    )
    sink = opened("dis")
    with pytest.raises(
        SinkError, match=r"UDP to 127\.0\.0\.1, port 3000: message too long; give a host"
    ):
        sink.write(tracked(1, state=STATE))
    assert sink.close().delivered == 0


def test_a_kind_of_address_that_the_system_lacks_fails_the_output(monkeypatch):
    refused = Mock(side_effect=OSError(errno.EAFNOSUPPORT, "not supported"))
    monkeypatch.setattr("opir_displays.display_sink.socket.socket", refused)
    with pytest.raises(SinkError, match=r"UDP to ::1, port 3000: .*; give a host"):
        opened("dis", host="::1")
