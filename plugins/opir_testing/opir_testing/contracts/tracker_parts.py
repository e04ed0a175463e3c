"""Conformance tests of tracker parts: a tracker with the part conforms, and the part does its work."""

from functools import cache
from typing import Any

import numpy as np

from opir_core.plugin import Tracker, TrackerPart
from opir_testing.contracts.contract import require
from opir_testing.contracts.trackers import TrackerContract

#: A tracker that has a key for each role, for parts that name none.
_TRACKER = "imm"

#: Detections of a target in its first ticks belong to no track yet; of the others a tracker that
#: works follows most.
_FOLLOWED_SHARE = 0.5


class TrackerPartContract(TrackerContract):
    """Conformance tests of a tracker part: those of trackers, for one with the part."""

    kind = TrackerPart

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with a tracker that has the part; `changes` replace keys."""
        part = cls.component()
        model = part.trackers[0] if part.trackers else _TRACKER
        block = {"model": model, part.role: {"model": cls.name, **cls.block()}}
        return super().scene(**{"tracker": block, **changes})

    @classmethod
    def tracker(cls) -> Tracker:
        """Return a new tracker with the part."""
        return cls.plan().make_tracker()

    @classmethod
    @cache
    def followed_share(cls) -> float:
        """Return the share of the detections of targets that belong to a track."""
        run = cls.run()
        of_target = run.truth.target >= 0
        followed = run.detections.track >= 0
        count = int(np.count_nonzero(of_target))
        return int(np.count_nonzero(followed & of_target)) / max(count, 1)

    def test_targets_are_followed(self) -> None:
        """Most detections of targets belong to a track."""
        share = self.followed_share()
        require(
            share >= _FOLLOWED_SHARE,
            f"{share:.0%} of the detections of targets belong to a track",
            "Compare the part with the default one of its role in a scene of one target.",
        )
