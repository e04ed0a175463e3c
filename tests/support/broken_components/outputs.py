"""Broken encoders and sinks."""

import json
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np
from attrs import frozen

from broken_components.offers import SOUND, mutant
from opir_core.interfaces.outputs import Delivery
from opir_core.output.events.forge import ForgeEncoder
from opir_core.plugin import EventEncoder, SinkModel, Transport, text
from opir_core.random_streams.detection_ids import uuid_text


class OwnEncoder(ForgeEncoder):
    """The built-in encoder, changed."""


def encoder_mutant(name, caught_by):
    """Offer an encoder of a class of its own."""

    def offered(component):
        mutant(EventEncoder, name, caught_by)(lambda _config, context: component(context))
        return component

    return offered


@encoder_mutant("forgets-the-last", "test_each_detection_is_one_line")
class ForgetsTheLast(OwnEncoder):
    def encode(self, window):
        return b"\n".join(super().encode(window).splitlines()[:-1])


@encoder_mutant("numbers-lines", "test_windows_encode_alone_as_together")
class NumbersLines(OwnEncoder):
    content_type = "text/plain"

    def encode(self, window):
        return b"".join(b"%d\n" % number for number in range(len(window.detections)))


@encoder_mutant("tells-the-truth", "test_no_truth_is_written")
class TellsTheTruth(OwnEncoder):
    content_type = "text/plain"

    def encode(self, window):
        return b"".join(b"%r\n" % range_m for range_m in window.truth.range_m.tolist())


@encoder_mutant("nan-in-json", "test_json_follows_the_schema")
class NanInJson(OwnEncoder):
    def encode(self, window):
        return b"".join(
            json.dumps({"snr": snr}).encode() + b"\n" for snr in window.detections.snr.tolist()
        )


@encoder_mutant("unsaid", "test_media_type_and_schema_version_are_stated")
class Unsaid(OwnEncoder):
    content_type = ""


@encoder_mutant("stamps", "test_clock_network_and_global_random_state_are_not_used")
class Stamps(OwnEncoder):
    def encode(self, window):
        time.time_ns()
        return super().encode(window)


class Counts:
    """A sink that counts, wrongly by `wrong`."""

    wrong = 0

    def __init__(self):
        self.taken = self.wrong

    def write(self, window):
        self.taken += len(window.detections)

    def close(self):
        return Delivery(delivered=self.taken)


def sink_mutant(name, caught_by, **abilities):
    """Offer a sink of a class of its own."""

    def offered(component):
        mutant(SinkModel, name, caught_by, **abilities)(lambda _config, _context: component())
        return component

    return offered


@sink_mutant("one-too-many", "test_a_sink_without_windows_delivers_nothing")
class OneTooMany(Counts):
    wrong = 1


@sink_mutant("loses-some", "test_every_event_is_accounted_for")
class LosesSome(Counts):
    def write(self, window):
        self.taken += len(window.detections) - (len(window.detections) > 20)


@sink_mutant("trips-over-nothing", "test_windows_without_events_are_accepted")
class TripsOverNothing(Counts):
    def write(self, window):
        self.taken += (
            1 + int(np.argmax(window.detections.time_ns)) if len(window.detections) == 3 else 0
        )
        window.detections.time_ns[0]


@sink_mutant("scribbles", "test_windows_are_not_modified")
class Scribbles(Counts):
    def write(self, window):
        super().write(window)
        window.detections.confidence.flags.writeable = True
        window.detections.confidence[:] = 0.0


@sink_mutant("knows-no-tracks", "test_edge_case_windows_are_accepted")
class KnowsNoTracks(Counts):
    def write(self, window):
        self.taken += int(np.sum(window.detections.track < 0))


@sink_mutant("runs-ahead", "test_every_event_is_accounted_for")
class RunsAhead(Counts):
    def delivery_so_far(self):
        return Delivery(delivered=self.taken + 1)


@sink_mutant("half-buffered", "test_optional_abilities_are_complete")
class HalfBuffered(Counts):
    waits = 0


class ShortTruth:
    """A truth file as JSON that loses the last detection."""

    def __init__(self, _path, place, _target_ids, records):
        self._place = place
        self._rows = list(records)

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self._place.write_text(json.dumps(self._rows[:-1]))

    def write(self, window):
        self._rows += [{"detection_id": text} for text in uuid_text(window.detections.detection_id)]


sink_mutant(
    "short-truth",
    "test_truth_is_read_back",
    open_truth=ShortTruth,
    read_truth=lambda path: json.loads(path.read_text()),
)(Counts)


@frozen(kw_only=True)
class FileConfig:
    """Settings of sinks that write a file."""

    path: str = text(default="counts.txt", help="the file")


@frozen(kw_only=True)
class EncodedConfig:
    """Settings of sinks that send messages."""

    encoder: str = text(default="forge", help="the event encoder")


class CountFile(Counts):
    """Writes a letter for each detection into a file."""

    def __init__(self, config, context):
        super().__init__()
        self.thread = threading.get_ident()
        self.place = Path(config.path) if context.resumes else context.stage(config.path)
        self.file = self.place.open(self.mode(context), encoding="utf-8")

    def mode(self, context):
        return "a" if context.resumes else "w"

    def write(self, window):
        super().write(window)
        self.file.write("x" * len(window.detections))

    def close(self):
        self.file.close()
        return super().close()


def file_mutant(name, caught_by):
    """Offer a sink with a file."""
    return mutant(SinkModel, name, caught_by, FileConfig)


SOUND.add((SinkModel.hook, "sound-file"))
file_mutant("sound-file", "")(CountFile)


@file_mutant("makes-its-file-anew", "test_a_batch_run_succeeds_and_succeeds_again")
class MakesItsFileAnew(CountFile):
    """Refuses a file that exists, as a database does that finds an empty one."""

    def mode(self, context):
        return "a" if context.resumes else "x"


@file_mutant("replaces-its-file", "test_a_batch_run_succeeds_and_succeeds_again")
class ReplacesItsFile(CountFile):
    def close(self):
        self.file.close()
        self.place.with_suffix(".new").write_text("x" * self.taken)
        self.place.with_suffix(".new").replace(self.place)
        return Counts.close(self)

    def write(self, window):
        Counts.write(self, window)


@file_mutant("of-one-thread", "test_a_live_run_succeeds")
class OfOneThread(CountFile):
    """Works in the thread alone that has opened it, as a connection of sqlite3."""

    def write(self, window):
        if threading.get_ident() != self.thread:
            raise RuntimeError("this connection belongs to another thread")
        super().write(window)


@file_mutant("overwrites", "test_a_run_with_a_spool_continues_its_output")
class Overwrites(CountFile):
    def mode(self, context):
        return "w"


class Letters(Transport):
    """Keeps what it sends."""

    def __init__(self):
        self.sent = []

    def send(self, batch):
        self.sent += batch.messages()
        acknowledged = Future()
        acknowledged.set_result(None)
        return acknowledged

    def close(self, wait_s):
        return


SOUND.add((SinkModel.hook, "sound-transport"))
sink_mutant("sound-transport", "", config=EncodedConfig)(Letters)


@mutant(SinkModel, "knows-no-spool", "test_a_run_with_a_spool_continues_its_output", EncodedConfig)
def knows_no_spool(_config, context):
    return {False: Letters}[context.resumes]()


@sink_mutant("built-of-none", "test_build_returns_a_complete_part")
def nothing():
    return None


@sink_mutant("without-close", "test_build_returns_a_complete_part")
class WithoutClose:
    def write(self, window):
        return


@mutant(SinkModel, "goes-past-the-stage", "test_a_run_that_is_given_up_leaves_no_file")
def goes_past_the_stage(_config, _context):
    Path("events.out").write_text("", encoding="utf-8")
    return Counts()
