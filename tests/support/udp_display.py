"""A display that hears what a sink sends it over UDP, on this machine."""

import socket
from contextlib import contextmanager

from attrs import evolve
from opir_testing import stub_estimates
from opir_testing.doubles import stub_window

from opir_core.plugin import EncoderContext, Host, SinkContext, SinkModel

EPOCH_US = 1_775_044_800_000_000  # 2026-04-01T12:00:00Z
#: So long a datagram is waited for, s.
PATIENCE_S = 60.0


@contextmanager
def listening():
    """Yield a socket that listens at a free port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as display:
        display.bind(("127.0.0.1", 0))
        display.settimeout(PATIENCE_S)
        yield display


def port_of(display):
    """Return the port of a display."""
    return display.getsockname()[1]


def heard(display, count):
    """Return the next datagrams of a display."""
    return [display.recv(65_536) for _ in range(count)]


def opened(name, *, scene_name="stub", **settings):
    """Return a sink of the name, open."""
    component = Host.discover().component(SinkModel, name)
    origin = EncoderContext(sensors=(), epoch_us=EPOCH_US)
    context = SinkContext(make_encoder=None, scene_name=scene_name, origin=origin)
    return component.build(component.config(**settings), context)


def tracked(count, start_s=0.0, end_s=100.0, **columns):
    """Return a window of tracks: a row a second of track 0 unless given."""
    return evolve(
        stub_window(0), start_s=start_s, end_s=end_s, tracks=stub_estimates(count, **columns)
    )


def sent(name, windows, **settings):
    """Return the datagrams of windows, and the counts of the sink."""
    with listening() as display:
        sink = opened(name, port=port_of(display), **settings)
        for window in windows:
            sink.write(window)
        delivery = sink.close()
        return heard(display, sink.sent), delivery
