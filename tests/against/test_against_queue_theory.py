"""The queues of links against an event loop of their own, and against the theory of queues."""

import numpy as np
import pytest
from opir_testing import stub_window
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.planning.plan import compile_plan

LIGHT_M_S = 299_792_458.0
NS = 1_000_000_000


def network(outages=(), **downlink):
    """Return the links of a geostationary sensor above its station."""
    station = {"id": "HI", "lat_deg": 0.0, "lon_deg": -150.0}
    block = {"stations": [station], "downlinks": [downlink], "outages": list(outages)}
    scene = opir.scene_from_mapping(two_sensor_scene(duration_s=86_400.0, links=block))
    return compile_plan(scene).links


def waits_ns(links, time_ns, pieces=1):
    """Return the waits of reports with looks at times (n,), before they are sent."""
    queues = links.queues(2)
    parts = [
        queues.passed_on(stub_window(len(part), time_ns=part, sensor=0)).detections
        for part in np.array_split(time_ns, pieces)
    ]
    delays = np.concatenate([part.reported_ns - part.time_ns for part in parts])
    radius_m = (3.986004418e14 / 7.292115e-5**2) ** (1.0 / 3.0)
    height_m = radius_m - 6_378_137.0
    return delays - links.transmitters[0].service_ns - round(1e9 * height_m / LIGHT_M_S)


def poisson_ns(rate_per_s, count, seed):
    rng = np.random.default_rng(seed)
    return np.rint(np.cumsum(rng.exponential(1e9 / rate_per_s, count))).astype(np.int64)


@pytest.mark.parametrize("load", [0.5, 0.8])
def test_waits_are_those_of_the_m_d_1_queue(load):
    service_s = 0.1
    links = network(rate_bytes_s=1000.0, message_bytes=100)
    waits_s = waits_ns(links, poisson_ns(load / service_s, 400_000, seed=17)) * 1e-9
    # Pollaczek and Khinchine, constant service.
    mean_s = load * service_s / (2.0 * (1.0 - load))
    # Waits near each other depend on each other: the error is that of means of long batches.
    batches = waits_s.reshape(200, -1).mean(axis=1)
    error_s = batches.std(ddof=1) / np.sqrt(len(batches))
    assert error_s < 0.03 * mean_s
    assert waits_s.mean() == pytest.approx(mean_s, abs=3.0 * error_s)
    # A report that finds the transmitter idle does not wait.
    share = (waits_s < 1e-6).reshape(200, -1).mean(axis=1)
    error = share.std(ddof=1) / np.sqrt(len(share))
    assert share.mean() == pytest.approx(1.0 - load, abs=3.0 * error)


@pytest.mark.parametrize("pieces", [1, 7, 300])
def test_waits_are_those_of_an_event_loop_through_outages(pieces):
    spans_s = [(40.0, 55.0), (90.0, 91.0), (300.0, 420.0)]
    outages = [{"node": "HI", "at_s": start, "until_s": stop} for start, stop in spans_s]
    links = network(outages, rate_bytes_s=1000.0, message_bytes=130)
    time_ns = poisson_ns(5.0, 3000, seed=4)
    free_ns = 0
    expected = []
    for look_ns in time_ns.tolist():
        free_ns = max(free_ns, look_ns)
        left_ns = 130_000_000
        for start_ns, stop_ns in ((round(a * NS), round(b * NS)) for a, b in spans_s):
            if free_ns + left_ns > start_ns and free_ns < stop_ns:
                left_ns -= max(start_ns - free_ns, 0)
                free_ns = stop_ns
        free_ns += left_ns
        expected.append(free_ns - look_ns - 130_000_000)
    waits = waits_ns(links, time_ns, pieces)
    assert np.abs(waits - np.array(expected)).max() <= 1
    assert waits.max() > 100 * NS


def test_lost_reports_are_as_many_as_their_rate_says():
    count = 200_000
    links = network(rate_bytes_s=1e9, loss=0.03)
    rng = np.random.default_rng(8)
    window = stub_window(
        count,
        time_ns=poisson_ns(10.0, count, seed=2),
        detection_id=rng.integers(0, 2**63, (count, 2), dtype=np.uint64),
    )
    lost = links.queues(2).passed_on(window).lost
    assert lost.tolist() == [lost[0], 0]
    assert lost[0] == pytest.approx(0.03 * count, abs=3.0 * np.sqrt(0.03 * 0.97 * count))
