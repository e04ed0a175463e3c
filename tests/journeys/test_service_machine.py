"""A service through any sequence of launches, settings, restarts, kills, and faults of broker and
disk keeps its books.

At any moment: given + recovered = delivered + spooled + withheld + dropped, and it is ready only
while cycles end. Once all faults are over: it is ready again, and everything has arrived, each
sensor's events in order, none changed.

OPIR_SERVICE_MACHINE_S=3600 lets it run for that time, with new sequences.
"""

import errno
import os
import time
from contextlib import closing, contextmanager
from typing import Any

import kafka_broker
import pytest
from failing_disk import READ, SHORT, SYNC, WRITE, WRITING, can_fail
from hypothesis import HealthCheck, Phase, settings, strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from kafka_broker import INIT_PRODUCER_ID, METADATA, PRODUCE
from serve_process import Nursery, nursery
from watched_service import WatchedService

LONG_S = float(os.environ.get("OPIR_SERVICE_MACHINE_S", "0"))
EXAMPLES = 4
STEPS = 10

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(LONG_S + 900.0),
    pytest.mark.skipif(
        not hasattr(os, "fork") or not can_fail(), reason="needs POSIX processes and SQLite's calls"
    ),
]

ERRORS = st.sampled_from([errno.EIO, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, SHORT])
KINDS = st.sampled_from([WRITING, (WRITE,), (SYNC,), (READ,), (*WRITING, READ)])


class ServiceMachine(RuleBasedStateMachine):
    """The service, and what may befall it."""

    nurse: Nursery
    broker: Any
    service: WatchedService

    @initialize()
    def begin(self):
        self.service = WatchedService(self.nurse, self.broker)

    @precondition(lambda self: not self.service.is_faulty)
    @rule()
    def launch(self):
        self.service.launch()

    @precondition(lambda self: not self.service.is_faulty)
    @rule(
        period_ms=st.sampled_from([1000.0, 5000.0, 10000.0]),
        client=st.sampled_from(["opir", "other"]),
    )
    def configure(self, period_ms, client):
        self.service.configure(period_ms, client)

    @rule(is_up=st.booleans())
    def broker_goes_or_comes(self, is_up):
        if not self.service.is_frozen:
            self.broker.tell("up" if is_up else "down")

    @rule(code=st.sampled_from([2, 5, 6, 7, 19, 29, 42, 47]), count=st.sampled_from([1, 3, 50]))
    def broker_answers_with_errors(self, code, count):
        if not self.service.is_frozen:
            self.broker.tell("error", PRODUCE, *[code] * count)

    @rule(
        api=st.sampled_from([METADATA, INIT_PRODUCER_ID]), slow_ms=st.sampled_from([0, 100, 2500])
    )
    def broker_is_slow(self, api, slow_ms):
        if not self.service.is_frozen:
            self.broker.tell("slow", slow_ms)
            self.broker.tell("error", api, 7, -1)

    @rule(is_frozen=st.booleans())
    def broker_stops_answering(self, is_frozen):
        (self.service.freeze if is_frozen else self.service.thaw)()

    @rule(number=st.integers(1, 40), error=ERRORS, lasts=st.booleans(), kinds=KINDS)
    def disk_fails(self, number, error, lasts, kinds):
        self.service.fail_disk(number, error, lasts, kinds)

    @rule()
    def disk_heals(self):
        self.service.heal_disk()

    @rule(output=st.sampled_from(["jsonl", "kafka"]))
    def output_is_retried(self, output):
        assert self.service.ask("POST", f"/outputs/{output}/retry")[0] < 500

    @rule()
    def time_passes(self):
        time.sleep(0.5)

    @rule(is_killed=st.booleans())
    def restarts(self, is_killed):
        (self.service.kill if is_killed else self.service.stop)()
        self.service.start()

    @rule(
        name=st.sampled_from(["a.spool", "b.spool"]),
        seed=st.integers(0, 99),
        flips=st.sampled_from([1, 64]),
    )
    def spool_is_damaged(self, name, seed, flips):
        self.service.stop()
        self.service.damage(name, seed, flips)
        self.service.start()

    @invariant()
    def books_and_readiness(self):
        if hasattr(self, "service"):
            self.service.observe()

    def teardown(self):
        if hasattr(self, "service"):
            self.service.close()


@contextmanager
def surroundings():
    """Have a broker and a place where processes come from."""
    with closing(kafka_broker.MockBroker()) as broker, nursery("faulty_process") as nurse:
        ServiceMachine.broker = broker
        ServiceMachine.nurse = nurse
        yield


def profile(**changes):
    # A failure is shown as it is: to shrink it would take hours.
    return settings(
        deadline=None,
        stateful_step_count=STEPS,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
        database=None,
        report_multiple_bugs=False,
        **changes,
    )


def test_any_sequence_keeps_the_books():
    if not LONG_S:
        with surroundings():
            run_state_machine_as_test(
                ServiceMachine, settings=profile(max_examples=EXAMPLES, derandomize=True)
            )
        return
    give_up_at = time.monotonic() + LONG_S
    while time.monotonic() < give_up_at:
        with surroundings():  # anew, for the broker keeps every topic
            run_state_machine_as_test(ServiceMachine, settings=profile(max_examples=5 * EXAMPLES))
