"""Tracks, launch and impact points as Cursor on Target events.

The elements are those of MITRE's public schema (Event.xsd, version 2.0, MITRE case 11-3895) and of
its sub-schemas contact, track, shape and remarks. Every event says that it is simulated.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.estimation import containment_ellipse
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.interfaces import IMPACT_METHODS
from opir_core.output import (
    rounded_bearing_deg,
    rounded_degrees,
    rounded_longitude_deg,
    time_texts,
)
from opir_core.plugin import Tracks, Window
from opir_displays.reported_types import UNKNOWN, reported_types
from opir_displays.settings import CotConfig

#: The probability that a place is within the ellipse of one standard deviation.
_ONE_SIGMA = -math.expm1(-0.5)

_EVENT = (
    '<event version="2.0" uid="opir.{scene}.{uid}" type="{type}" how="m-s" opex="s"'
    ' time="{time}" start="{start}" stale="{stale}">'
    '<point lat="{lat:.8f}" lon="{lon:.8f}" hae="{hae:.2f}" ce="{ce:.1f}" le="{le:.1f}"/>'
    '<detail><contact callsign="{callsign}"/>{detail}<remarks>simulated; {remarks}</remarks></detail>'
    "</event>"
)
_TRACK = '<track course="{:.4f}" speed="{:.3f}" slope="{:.4f}"/>'
_ELLIPSE = '<shape><ellipse major="{:.1f}" minor="{:.1f}" angle="{:.2f}"/></shape>'


class CotEvents:
    """Tracks as events: each track, its launch point and its impact point, where known."""

    def __init__(self, config: CotConfig, epoch_us: int, scene_name: str) -> None:
        self._config = config
        self._epoch_us = epoch_us
        self._scene = escape(scene_name)

    def rows(self, window: Window) -> Iterator[tuple[int, Sequence[bytes]]]:
        """Yield the events of each of the window's tracks."""
        tracks = window.tracks
        is_paper = tracks.impact_method == IMPACT_METHODS.index("paper")
        # The sigma of the paper's law is not an area of uncertainty.
        spread = np.where(is_paper[:, None, None], np.nan, tracks.impact_covariance)
        columns = (
            self._states(tracks),
            self._points(tracks, "launch", tracks.launch, tracks.launch_covariance, None),
            self._points(tracks, "impact", tracks.impact, spread, tracks.impact_sigmas),
        )
        for events in zip(*columns, strict=True):
            yield 1, [event.encode() for event in events if event]

    def _states(self, tracks: Tracks) -> list[str]:
        """Return the events of tracks (n,) at their ticks, "" if the state is unknown."""
        position = tracks.state[:, :3]
        velocity = tracks.state[:, 3:]
        place = ecef_to_geodetic(position)
        axes = local_axes(position)
        east, north, up = np.einsum("nij,nj->in", axes, velocity)
        spread = axes @ tracks.state_covariance[:, :3, :3] @ axes.swapaxes(1, 2)
        over_ground = np.hypot(east, north)
        motion = (
            rounded_bearing_deg(np.arctan2(east, north), 360.0),
            over_ground,
            np.degrees(np.arctan2(up, over_ground)),
        )
        # Errors are those of one standard deviation (Event.xsd, point).
        ellipse = containment_ellipse(spread[:, :2, :2], _ONE_SIGMA)
        names, shares = reported_types(tracks)
        atom = f"a-{self._config.affiliation}-A"
        numbers = tracks.track.tolist()
        return self._events(
            tracks,
            tracks.state,
            {
                "uid": numbers,
                "type": [atom if name == UNKNOWN else f"{atom}-W-M" for name in names],
                "callsign": [
                    f"T{track} {name}" for track, name in zip(numbers, names, strict=True)
                ],
                "lat": np.degrees(place.latitude_rad),
                "lon": np.degrees(place.longitude_rad),
                "hae": place.height_m,
                "ce": _known(ellipse.semi_major_m),
                "le": _known(np.sqrt(np.maximum(spread[:, 2, 2], 0.0))),
                "detail": [_TRACK.format(*row) for row in zip(*motion, strict=True)],
                "remarks": [
                    f"{name} {share:.2f}" for name, share in zip(names, shares, strict=True)
                ],
            },
        )

    def _points(
        self,
        tracks: Tracks,
        kind: str,
        place: FloatArray,
        covariance: FloatArray,
        sigmas: FloatArray | None,
    ) -> list[str]:
        """Return the events of the launch or impact points (n, 3) of tracks, "" if unknown; the
        last three as in `Tracks`.
        """
        filled = np.nan_to_num(place)
        ellipse = containment_ellipse(covariance[:, :2, :2], reported_sigmas=sigmas)
        shapes = [
            _ELLIPSE.format(*axes, np.degrees(bearing)) if axes[0] < np.inf else ""
            for *axes, bearing in zip(*ellipse, strict=True)
        ]
        times = time_texts(place[:, 2], self._epoch_us)
        nothing = np.zeros(len(place))
        return self._events(
            tracks,
            place[:, :2],
            {
                "uid": [f"{track}.{kind}" for track in tracks.track.tolist()],
                "type": ["u-d-c-c" if shape else "b-m-p-s-m" for shape in shapes],
                "callsign": [f"T{track} {kind}" for track in tracks.track.tolist()],
                "lat": rounded_degrees(filled[:, 0]),
                "lon": rounded_longitude_deg(np.mod(filled[:, 1], 2.0 * np.pi)),
                "hae": nothing,
                "ce": _known(ellipse.semi_major_m),
                "le": _known(nothing * np.nan),
                "detail": shapes,
                "remarks": [f"{kind} at {time or 'an unknown time'}" for time in times],
            },
        )

    def _events(
        self,
        tracks: Tracks,
        coordinates: FloatArray,
        columns: Mapping[str, Sequence[Any] | FloatArray],
    ) -> list[str]:
        """Return the columns of events (n,) as XML, "" if coordinates (n, k) are unknown; those of
        a track that has ended are stale at once.
        """
        valid_s = np.where(tracks.end > 0, 0.0, self._config.stale_s)
        times = {
            "time": time_texts(tracks.available_s, self._epoch_us),
            "start": time_texts(tracks.tick_s, self._epoch_us),
            "stale": time_texts(tracks.available_s + valid_s, self._epoch_us),
        }
        rows = zip(*times.values(), *columns.values(), strict=True)
        is_known = np.asarray(np.isfinite(coordinates).all(axis=1))
        return [
            _EVENT.format(scene=self._scene, **dict(zip([*times, *columns], row, strict=True)))
            if known and None not in row[:3]
            else ""
            for known, row in zip(is_known, rows, strict=True)
        ]


def _known(errors_m: FloatArray) -> FloatArray:
    """Return errors (n,), m, and the format's value for one that is unknown."""
    return np.where(np.isfinite(errors_m), errors_m, 9_999_999.0)
