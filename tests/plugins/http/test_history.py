"""The filters of `GET /detections`: all that are given hold at once, whatever their number."""

from itertools import product
from types import SimpleNamespace

import numpy as np
from opir_http.history import Filter, History

COUNT = 300


def test_detections_pass_if_they_pass_every_filter() -> None:
    rng = np.random.default_rng(4)
    rows = SimpleNamespace(
        sensor=rng.integers(0, 3, COUNT),
        reported_type=rng.integers(0, 3, COUNT),
        track=rng.integers(-1, 2, COUNT),
        confidence=rng.uniform(size=COUNT),
    )
    time_us = np.sort(rng.integers(0, 1000, COUNT))
    history = History(COUNT)
    history.add(rows, time_us, [str(number).encode() for number in range(COUNT)])
    passes = {
        "sensors": ((0, 2), np.isin(rows.sensor, [0, 2])),
        "types": ((1, 2), rows.reported_type > 0),
        "track": (1, rows.track == 1),
        "since_us": (int(time_us[40]), time_us >= time_us[40]),
        "until_us": (int(time_us[250]), time_us < time_us[250]),
        "confidence": (0.3, rows.confidence >= 0.3),
    }
    for choice in product((False, True), repeat=len(passes)):
        checks = {
            name: check
            for (name, check), is_given in zip(passes.items(), choice, strict=True)
            if is_given
        }
        criteria = Filter(**{name: value for name, (value, _) in checks.items()})
        rows_shown = np.flatnonzero(
            np.all([np.ones(COUNT, bool), *(mask for _, mask in checks.values())], axis=0)
        )
        lines, following = history.page(criteria, None, COUNT)
        assert [int(line) for line in lines] == rows_shown[::-1].tolist(), checks.keys()
        assert following is None
