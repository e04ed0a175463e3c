"""Compiles the links of a scene: contacts of all paths, outages, and when transmitters are open."""

import math
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import ModelError, Problem, SceneError
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces.sensors import Orbit, Sensor
from opir_core.orbits.contacts import contact_intervals, crosslink_intervals
from opir_core.orbits.orbit_models import GeostationaryOrbit
from opir_core.planning.links import Network, NetworkPath, StationPlace, Transmitter
from opir_core.random_streams.philox import failure_spans_s, stream_key
from opir_core.scene.links import ANY, Downlink, GroundStation, LinkOutage, Links
from opir_core.scene.scene import Scene

#: The purpose of the streams of outages at random.
STREAM = "link-outage"

#: The stage of reporting that links take the place of.
_REPLACED = "downlink"


def path_uses(network: Network, sensors: Sequence[Sensor], end_ns: int) -> list[Mapping[str, Any]]:
    """Return a row for each sensor and path that is used before an end, and one for the rest, as
    plain values.

    `share` is that of the time up to the end, `delay_s` from look to arrival without a queue, at
    the first use; `longest_s` the longest time in which the sensor has this path, or none, at once.
    """
    rows = list[Mapping[str, Any]]()
    for number, transmitter in network.transmitters.items():
        inside = transmitter.edge_ns[:-1] < end_ns
        start_ns = transmitter.edge_ns[:-1][inside]
        stop_ns = np.minimum(transmitter.edge_ns[1:][inside], end_ns)
        path = transmitter.path[inside]
        for used in np.unique(path).tolist():
            of_path = path == used
            delay_ns = transmitter.service_ns + (
                network.flight_ns(used, start_ns[of_path][:1])[0] if used >= 0 else 0
            )
            rows.append(
                {
                    "sensor_id": sensors[number].id,
                    "path": list(network.paths[used].hops) if used >= 0 else None,
                    "share": float((stop_ns - start_ns)[of_path].sum() / end_ns),
                    "longest_s": _longest_ns(start_ns, stop_ns, of_path) * 1e-9,
                    "delay_s": float(delay_ns * 1e-9) if used >= 0 else None,
                }
            )
    return rows


def _longest_ns(start_ns: IntArray, stop_ns: IntArray, has_path: BoolArray) -> int:
    """Return the longest time, ns, in which neighbouring spans (n,) have a path."""
    group = np.cumsum(np.diff(has_path, prepend=False))
    lengths_ns = np.bincount(group, np.where(has_path, stop_ns - start_ns, 0))
    return int(lengths_ns.max())


def network_of(scene: Scene, links: Links, sensors: Sequence[Sensor]) -> Network:
    """Return the links of a scene; raises `SceneError` for a sensor that has a latency of its
    downlink beside them.
    """
    stations = {station.id: _placed(station) for station in links.stations}
    satellites: dict[str, Orbit] = {sensor.id: sensor.orbit for sensor in sensors}
    satellites |= {relay.id: GeostationaryOrbit(relay.lon_deg) for relay in links.relays}
    downlinks = {number: links.downlink_of(sensor.id) for number, sensor in enumerate(sensors)}
    own = {number: downlink for number, downlink in downlinks.items() if downlink is not None}
    _require_one_downlink([sensors[number] for number in own])
    compiler = _Compiler(scene, links, satellites, stations)
    transmitters = {
        number: compiler.transmitter(sensors[number].id, downlink)
        for number, downlink in own.items()
    }
    return Network({**satellites, **stations}, tuple(compiler.paths), transmitters)


def _placed(station: GroundStation) -> StationPlace:
    latitude_rad = math.radians(station.lat_deg)
    place_m = geodetic_to_ecef(latitude_rad, math.radians(station.lon_deg), station.height_m)
    return StationPlace(place_m, math.radians(station.mask_deg))


def _require_one_downlink(sensors: Sequence[Sensor]) -> None:
    for sensor in sensors:
        latencies_s = [stage.mean_s for stage in sensor.reporting if stage.name == _REPLACED]
        if any(latencies_s):
            words = (
                f"{sensor.id} has reporting.{_REPLACED} too; links take its place, leave one out"
            )
            raise SceneError([Problem("links.downlinks", words)])


class _Compiler:
    """Compiles the transmitters of sensors; contacts of pairs of nodes are computed once."""

    def __init__(
        self,
        scene: Scene,
        links: Links,
        satellites: Mapping[str, Orbit],
        stations: Mapping[str, StationPlace],
    ) -> None:
        self._links = links
        self._satellites = satellites
        self._stations = stations
        self.paths = list[NetworkPath]()
        longest_s = max(downlink.keep_s for downlink in links.downlinks)
        self._scene_s = scene.duration_s
        self._end_s = scene.duration_s + longest_s
        self._contacts = cache(self._contact_ns)
        self._outages = [
            (outage.node, _outage_ns(scene.seed, number, outage, self._end_s))
            for number, outage in enumerate(links.outages)
        ]

    def transmitter(self, sensor: str, downlink: Downlink) -> Transmitter:
        """Return the transmitter of a sensor."""
        paths = self._paths_of(sensor, downlink)
        contacts = [list(map(self._contacts, path.nodes[:-1], path.nodes[1:])) for path in paths]
        outages = [[span for name, span in self._outages if name in path.nodes] for path in paths]
        spans = [span.ravel() for of_path in (*contacts, *outages) for span in of_path]
        end_ns = round(self._end_s * 1e9)
        edge_ns = np.unique(np.concatenate([*spans, [0, end_ns]]))
        edge_ns = edge_ns[(edge_ns >= 0) & (edge_ns <= end_ns)]
        # Between two edges nothing changes.
        is_open = np.array(
            [_is_open(edge_ns[:-1], *of_path) for of_path in zip(contacts, outages, strict=True)]
        )
        path = np.where(is_open.any(axis=0), len(self.paths) + is_open.argmax(axis=0), -1)
        lengths_ns = np.where(path >= 0, np.diff(edge_ns), 0)
        self.paths += paths
        return Transmitter(downlink, edge_ns, path, np.append(0, np.cumsum(lengths_ns)))

    def _paths_of(self, sensor: str, downlink: Downlink) -> list[NetworkPath]:
        """Return the paths of a sensor, in order, with satellites in place of `any`."""
        written = downlink.paths or tuple((station.id,) for station in self._links.stations)
        ways = [way for hops in written for way in self._ways(sensor, hops)]
        return [NetworkPath(way, self._delay_ns(way)) for way in dict.fromkeys(ways)]

    def _ways(self, sensor: str, hops: Sequence[str]) -> list[tuple[str, ...]]:
        """Return the ways from a sensor over hops, none of them twice."""
        choices = [[*self._satellites] if hop == ANY else [hop] for hop in hops]
        ways = product([sensor], *choices)
        return [way for way in ways if len(set(way)) == len(way)]

    def _delay_ns(self, way: Sequence[str]) -> int:
        delays_s = self._links.delays_s
        return round(1e9 * sum(delays_s.get(name, 0.0) for name in way))

    def _contact_ns(self, sender: str, receiver: str) -> IntArray:
        """Return the spans (n, 2), ns, in which a satellite and the next node see each other."""
        try:
            spans_s = self._contact_s(sender, receiver, self._end_s)
        except ModelError:  # an ephemeris may end with the scene
            spans_s = self._contact_s(sender, receiver, self._scene_s)
        return np.rint(spans_s * 1e9).astype(np.int64)

    def _contact_s(self, sender: str, receiver: str, stop_s: float) -> FloatArray:
        orbit = self._satellites[sender]
        station = self._stations.get(receiver)
        if station is None:
            clearance_m = 1e3 * self._links.clearance_km
            other_orbit = self._satellites[receiver]
            return crosslink_intervals(
                orbit, other_orbit, clearance_m=clearance_m, start_s=0.0, stop_s=stop_s
            )
        mask_rad = station.mask_rad
        return contact_intervals(
            orbit, station.ecef_m, mask_rad=mask_rad, start_s=0.0, stop_s=stop_s
        )


def _outage_ns(seed: int, number: int, outage: LinkOutage, end_s: float) -> IntArray:
    """Return the spans (n, 2), ns, of an outage; those at random by the seed."""
    stop_s = max(min(outage.end_s, end_s), outage.at_s)
    if outage.mtbf_s is None or outage.mttr_s is None:
        spans_s = np.array([[outage.at_s, stop_s]])
    else:
        spans_s = failure_spans_s(
            stream_key(seed, outage.node, STREAM, str(number)),
            mtbf_s=outage.mtbf_s,
            mttr_s=outage.mttr_s,
            start_s=outage.at_s,
            end_s=stop_s,
        )
    return np.rint(spans_s * 1e9).astype(np.int64)


def _is_open(
    time_ns: IntArray, contacts: Sequence[IntArray], outages: Sequence[IntArray]
) -> BoolArray:
    """Return whether a path is open from times (n,) on: in all contacts, and in none of the
    outages.
    """
    is_open = np.ones(len(time_ns), dtype=np.bool_)
    for spans in contacts:
        is_open &= _is_inside(spans, time_ns)
    for spans in outages:
        is_open &= ~_is_inside(spans, time_ns)
    return is_open


def _is_inside(spans_ns: IntArray, time_ns: IntArray) -> BoolArray:
    """Return whether times (n,) are in one of the spans (k, 2), which are in order."""
    begun, ended = (np.searchsorted(edge, time_ns, side="right") for edge in spans_ns.T)
    return begun > ended
