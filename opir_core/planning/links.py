"""The links of a plan: by sensor when its transmitter is open and which way a report takes then; the
queues of a run, and the looks of which a tracker has not heard.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry import components, length
from opir_core.interfaces.records import Detections, Window
from opir_core.interfaces.sensors import Orbit, Spans
from opir_core.random_streams.philox import further_words, purpose_number, uniforms_of
from opir_core.scene.links import Downlink

#: The purpose of the random number that decides whether a report is lost.
LOSS = "link-loss"


@frozen(eq=False)
class StationPlace:
    """A ground station as a node: it stands at (3,), ECEF, m."""

    ecef_m: FloatArray
    mask_rad: float

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        """Return its positions (n, 3) at times (n,)."""
        return np.broadcast_to(self.ecef_m, (len(time_s), 3))


@frozen(eq=False)
class Transmitter:
    """A sensor's transmitter: open or closed between `edge_ns` (k + 1,), with a path while open.

    `path` (k,) are numbers of the network's paths, -1 while closed; `open_ns` (k + 1,) is how long
    it has been open up to each edge. Times are those of the scene.
    """

    downlink: Downlink
    edge_ns: IntArray
    path: IntArray
    open_ns: IntArray

    @property
    def service_ns(self) -> int:
        """The time that it takes for a report, ns; at least 1."""
        return max(round(self.downlink.service_s * 1e9), 1)

    def unsent_s(self, wait_s: float) -> Spans:
        """Return the spans of looks whose reports are not sent within a time, nor while they are of
        use, s; queues are left out.
        """
        edge_ns = self.edge_ns
        if self.downlink.loss == 1.0:
            return ((0.0, edge_ns[-1] / 1e9),)
        closed = np.flatnonzero(self.path < 0)
        sent_ns, _ = self.sent(self.open_until_ns(edge_ns[closed]) + self.service_ns)
        of_use_ns = np.where(
            sent_ns < 0, edge_ns[-1], sent_ns - 1e9 * min(self.downlink.keep_s, wait_s)
        )
        until_ns = np.minimum(edge_ns[closed + 1], of_use_ns)
        spans_s = np.stack([edge_ns[closed], until_ns], axis=1) / 1e9
        return tuple((from_s, until_s) for from_s, until_s in spans_s.tolist() if from_s < until_s)

    def open_until_ns(self, time_ns: IntArray) -> IntArray:
        """Return how long (n,), ns, it has been open up to times (n,) of the scene."""
        segment = np.searchsorted(self.edge_ns, time_ns, side="right") - 1
        segment = np.clip(segment, 0, len(self.path) - 1)
        since_ns = np.minimum(time_ns, self.edge_ns[-1]) - self.edge_ns[segment]
        return self.open_ns[segment] + np.where(self.path[segment] >= 0, since_ns, 0)

    def sent(self, until_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Return when (n,), ns, it has been open for so long (n,), and its paths (n,) up to then.

        Both are -1 for what it is not open for.
        """
        segment = np.searchsorted(self.open_ns, until_ns, side="left") - 1
        is_sent = segment < len(self.path)
        segment = np.clip(segment, 0, len(self.path) - 1)
        time_ns = self.edge_ns[segment] + until_ns - self.open_ns[segment]
        return np.where(is_sent, time_ns, -1), np.where(is_sent, self.path[segment], -1)


@frozen(eq=False)
class NetworkPath:
    """A way from a sensor to the ground: its nodes, the sensor first, and what it delays in them."""

    nodes: tuple[str, ...]
    delay_ns: int

    @property
    def hops(self) -> tuple[str, ...]:
        """The nodes after the sensor."""
        return self.nodes[1:]


@frozen(eq=False)
class Network:
    """The links of a plan, by number of the sensor; `nodes` have the positions of its paths."""

    nodes: Mapping[str, Orbit | StationPlace]
    paths: tuple[NetworkPath, ...]
    transmitters: Mapping[int, Transmitter]

    def flight_ns(self, path: int, time_ns: IntArray) -> IntArray:
        """Return the times (n,), ns, that reports sent at times (n,) take along a path: light time
        by the places of its nodes then, and the delays in them.
        """
        time_s: FloatArray = time_ns.astype(np.float64) * 1e-9
        ends = [self.nodes[name].position_ecef_m(time_s) for name in self.paths[path].nodes]
        distance_m = np.zeros(len(time_ns))
        for before_m, after_m in pairwise(ends):
            distance_m += length(*components(after_m - before_m))
        light_ns = np.rint(distance_m * (1e9 / SPEED_OF_LIGHT_M_S)).astype(np.int64)
        return light_ns + self.paths[path].delay_ns

    def unheard_s(self, number: int, wait_s: float = np.inf) -> Spans:
        """Return the spans of looks of a sensor, by its number, whose reports do not arrive, or wait
        longer than a time for a contact; queues are left out.
        """
        transmitter = self.transmitters.get(number)
        return () if transmitter is None else transmitter.unsent_s(wait_s)

    def queues(self, sensors: int) -> "LinkQueues":
        """Return the empty queues of a run with as many sensors."""
        return LinkQueues(self, sensors)

    def unheard(self, sensors: int, lag_ns: int) -> "UnheardLooks":
        """Return the looks of which a tracker has not heard a lag after its ticks, of a run with as
        many sensors.
        """
        return UnheardLooks(self, sensors, lag_ns)

    @property
    def slowest_ns(self) -> int:
        """The time, ns, in which a report gets through the slowest path of any sensor, without a
        queue and a wait for a contact; 0 without a path.
        """
        slowest_ns = [
            transmitter.service_ns
            + max(
                int(self.flight_ns(path, transmitter.edge_ns[:-1][transmitter.path == path]).max())
                for path in np.unique(transmitter.path[transmitter.path >= 0]).tolist()
            )
            for transmitter in self.transmitters.values()
            if (transmitter.path >= 0).any()
        ]
        return max(slowest_ns, default=0)


class LinkQueues:
    """The queues of a run's transmitters, from window to window.

    Reports of a sensor enter its queue at the times of their looks, in this order; a report is sent
    once those before it are, while a path is open. All times are whole nanoseconds, so that
    nothing depends on the windows' edges.
    """

    def __init__(self, network: Network, sensors: int) -> None:
        self._network = network
        #: By sensor, how long its transmitter has been open when the last report was sent.
        self._busy_until_ns = np.zeros(sensors, dtype=np.int64)

    def take_over(self, former: "LinkQueues") -> None:
        """Go on with the queues of a run of the same sensors."""
        self._busy_until_ns[:] = former._busy_until_ns

    def passed_on(self, window: Window) -> Window:
        """Return a window with the reports that arrive, each with its path and its time of arrival.

        Windows follow each other. The latencies of `reporting` follow the arrival on the ground.
        """
        detections = window.detections
        path = np.full(len(detections), -1, dtype=np.int64)
        reported_ns = detections.reported_ns.copy()
        is_lost = np.zeros(len(detections), dtype=np.bool_)
        for number, transmitter in self._network.transmitters.items():
            rows = np.flatnonzero(detections.sensor == number)
            if len(rows):
                time_ns = detections.time_ns[rows]
                sent_ns, path[rows] = self._sent(number, transmitter, time_ns)
                arrived_ns = self._arrived_ns(sent_ns, path[rows])
                reported_ns[rows] += arrived_ns - time_ns
                is_late = arrived_ns - time_ns > 1e9 * transmitter.downlink.keep_s
                is_dropped = _loss_draws(detections.take(rows)) < transmitter.downlink.loss
                is_lost[rows] = (path[rows] < 0) | is_late | is_dropped
        return _arrived(window, path, reported_ns, is_lost, len(self._busy_until_ns))

    def _sent(
        self, number: int, transmitter: Transmitter, time_ns: IntArray
    ) -> tuple[IntArray, IntArray]:
        """Return when reports (n,) of a sensor have been sent, in the order of their looks, and
        their paths.

        A queue with one service time in the time for which its transmitter is open: Lindley's
        recursion (Proc. Cambridge Phil. Soc. 48, 1952, 277-289), f_i = max(u_i, f_(i-1)) + s, as a
        running maximum of u_i - i s.
        """
        service_ns = transmitter.service_ns
        waited_ns = service_ns * np.arange(len(time_ns))
        entered_ns = transmitter.open_until_ns(time_ns) - waited_ns
        entered_ns[0] = max(entered_ns[0], self._busy_until_ns[number])
        begun_ns = np.maximum.accumulate(entered_ns) + waited_ns
        finished_ns = begun_ns + service_ns
        self._busy_until_ns[number] = finished_ns[-1]
        return transmitter.sent(finished_ns)

    def _arrived_ns(self, sent_ns: IntArray, path: IntArray) -> IntArray:
        """Return when reports (n,), sent at times (n,), arrive by their paths (n,)."""
        arrived_ns = sent_ns.copy()
        for number in np.unique(path[path >= 0]).tolist():
            rows = np.flatnonzero(path == number)
            arrived_ns[rows] += self._network.flight_ns(number, sent_ns[rows])
        return arrived_ns


class UnheardLooks:
    """The looks of a run whose reports are under way when a tracker goes on, a lag after each tick.

    Reports are sent in order: a sensor is not heard while an earlier one is under way. `late_s` are
    the spans of such looks by sensor, s.
    """

    def __init__(self, network: Network, sensors: int, lag_ns: int) -> None:
        self._linked = list(network.transmitters)
        self._lag_ns = lag_ns
        self._stepped_ns = 0
        self.late_s: list[Spans] = [()] * sensors
        #: Sensor, time and report, ns, of detections from after the last tick, (3, n), and by sensor
        #: the latest report, ns, of those before.
        self._ahead = np.empty((3, 0), dtype=np.int64)
        self._latest_ns = np.full(sensors, -1)

    def note(self, detections: Detections) -> None:
        """Take detections that were observed, whenever they are reported."""
        columns = np.stack([detections.sensor, detections.time_ns, detections.reported_ns])
        columns = columns[:, np.isin(detections.sensor, self._linked)]
        self._ahead = np.concatenate([self._ahead, columns], axis=1)

    def step(self, tick_ns: int) -> Sequence[int]:
        """Go on to a tick; return the sensors, by number, that are not heard from some look after
        the tick before on.
        """
        step_ns = tick_ns + self._lag_ns
        is_before = self._ahead[1] < tick_ns
        sensor, time_ns, reported_ns = self._ahead[:, is_before]
        self._ahead = self._ahead[:, ~is_before]
        is_late = reported_ns >= step_ns
        first_ns: IntArray = np.where(self._latest_ns >= step_ns, self._stepped_ns, tick_ns)
        np.minimum.at(first_ns, sensor[is_late], time_ns[is_late])
        np.maximum.at(self._latest_ns, sensor, reported_ns)
        self._stepped_ns = tick_ns
        unheard: list[int] = np.flatnonzero(first_ns < tick_ns).tolist()
        for number in unheard:
            former = self.late_s[number]
            from_s = int(first_ns[number]) * 1e-9
            if former and former[-1][1] == from_s:
                from_s = former[-1][0]
                former = former[:-1]
            self.late_s[number] = (*former, (from_s, tick_ns * 1e-9))
        return unheard


def _loss_draws(detections: Detections) -> FloatArray:
    """Return a number in [0, 1) for each detection, by its id."""
    words = detections.detection_id[:, 1].copy()
    return uniforms_of(further_words(words, np.array([purpose_number(LOSS)])))


def _arrived(
    window: Window, path: IntArray, reported_ns: IntArray, is_lost: BoolArray, sensors: int
) -> Window:
    """Return a window without the reports that are lost, and how many these are by sensor."""
    detections = window.detections.replaced(reported_ns=reported_ns, path=path[:, None])
    lost = np.bincount(detections.sensor[is_lost], minlength=sensors)
    rows = np.flatnonzero(~is_lost)
    return evolve(
        window,
        detections=detections.take(rows).freeze(),
        truth=window.truth.take(rows).freeze(),
        lost=lost,
    )
