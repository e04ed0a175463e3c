"""Reports on their way: queues of transmitters, losses, and times of arrival; imported only for scenes
with links.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.records import Detections, Window
from opir_core.planning.links import Network, Transmitter
from opir_core.random_streams.philox import further_words, purpose_number, uniforms_of

#: The purpose of the random number that decides whether a report is lost.
LOSS = "link-loss"


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
