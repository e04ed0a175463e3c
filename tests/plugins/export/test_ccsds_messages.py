"""CCSDS messages of a run, read by other libraries: `oem` and `ccsds-ndm`, and turned by ERFA."""

from functools import cache
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
from astropy.time import Time, TimeDelta
from attrs import evolve
from ccsds_ndm.ndm_io import NdmIo
from exported_runs import exported, short_run
from oem import OrbitEphemerisMessage
from read_files import read
from repository import EXAMPLES

import opir_core

EPOCH = np.datetime64("2026-04-01T12:00:00", "us")


@pytest.fixture(scope="module")
def ephemerides(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("oem")
    files = exported(short_run(), "oem", folder)
    assert sorted(files) == sorted(folder.iterdir())
    return folder


@cache
def first_seconds() -> opir_core.Run:
    """Return a run with few detections: the reader takes a millisecond for each line."""
    run = short_run()
    limit = slice(0, 900)
    return evolve(run, detections=run.detections.take(limit), truth=run.truth.take(limit))


def tracking_data(tmp_path: Path, *settings: str) -> list[Any]:
    (path,) = exported(first_seconds(), "tdm", tmp_path / "run.tdm", *settings)
    return list(NdmIo().from_path(path).body.segment)


def scene_seconds(texts: list[str]) -> np.ndarray[Any, Any]:
    return (np.array(texts, dtype="datetime64[us]") - EPOCH) / np.timedelta64(1, "s")


@pytest.mark.slow
def test_sensors_and_flights_have_their_messages(ephemerides: Path) -> None:
    run = short_run()
    targets = [f"target-{target.id}.oem" for target in run.plan.scene.targets]
    sensors = [f"sensor-{sensor.id}.oem" for sensor in run.sensors]
    assert sorted(path.name for path in ephemerides.iterdir()) == sorted([*targets, *sensors])
    for name, segments in (
        (targets[0], 2),
        (sensors[0], 1),
    ):  # a target has its burn, and the flight after it
        stretches = list(OrbitEphemerisMessage.open(ephemerides / name))
        assert len(stretches) == segments
        for segment in stretches:
            assert segment.metadata["OBJECT_NAME"] == name.partition("-")[2].removesuffix(".oem")
            assert segment.metadata["REF_FRAME"] == "ITRF2000"
            assert np.isfinite([state.position for state in segment]).all()


def test_ranges_between_the_states_are_those_of_the_truth(ephemerides: Path) -> None:
    run = short_run()
    burn, _ = OrbitEphemerisMessage.open(ephemerides / f"target-{run.target_ids[0]}.oem")
    sensor = run.detections.sensor[np.flatnonzero(run.truth.target == 0)[0]]
    (orbit,) = OrbitEphemerisMessage.open(ephemerides / f"sensor-{run.sensors[sensor].id}.oem")
    rows = np.flatnonzero((run.truth.target == 0) & (run.detections.sensor == sensor))
    epoch = Time("2026-04-01T12:00:00", scale="utc", precision=9)
    for row in rows[:: len(rows) // 6].tolist():
        emitted = epoch + TimeDelta(float(run.truth.emission_time_s[row]), format="sec")
        looked = epoch + TimeDelta(float(run.detections.time_s[row]), format="sec")
        between = (burn(emitted).position - orbit(looked).position) * 1e3
        assert np.linalg.norm(between) == pytest.approx(run.truth.range_m[row], abs=0.5)


def test_states_at_burnout_are_those_of_the_truth(ephemerides: Path) -> None:
    truth = short_run().plan.targets.truth()[0]
    burn, _ = OrbitEphemerisMessage.open(ephemerides / f"target-{truth['id']}.oem")
    final = list(burn)[-1]
    np.testing.assert_allclose(final.position * 1e3, truth["burnout"]["position_ecef_m"], atol=1e-2)
    np.testing.assert_allclose(
        final.velocity * 1e3, truth["burnout"]["velocity_ecef_m_s"], atol=1e-2
    )


def test_opir_flies_its_own_ephemerides(ephemerides: Path) -> None:
    run = short_run()
    target = run.plan.scene.targets[0].id
    text = (ephemerides / f"target-{target}.oem").read_text()
    table = read("oem", text, run.plan.scene.epoch_us)
    truth = next(
        target_truth for target_truth in run.plan.targets.truth() if target_truth["id"] == target
    )
    assert table.time_s[0] == pytest.approx(truth["ignition_s"], abs=1e-6)
    assert table.time_s[-1] == pytest.approx(truth["impact"]["time_s"], abs=2e-6)
    in_burn = table.time_s <= truth["burnout_s"]
    expected = run.plan.targets.position_ecef_m(
        np.zeros(in_burn.sum(), dtype=np.int32), table.time_s[in_burn]
    )
    np.testing.assert_allclose(table.position_m[in_burn], expected, atol=1e-2)


@pytest.mark.slow
def test_stages_and_dark_gaps_are_segments_that_meet(tmp_path: Path) -> None:
    scene = opir_core.load_scene(EXAMPLES / "gravity_turn.yaml", overrides=["duration_s=31"])
    run = opir_core.simulate(scene)
    files = {
        path.stem.removeprefix("target-"): path for path in exported(run, "oem", tmp_path / "out")
    }
    counts = []
    for truth, burns_s in zip(run.plan.targets.truth(), run.plan.targets.burns_s, strict=True):
        path = files[truth["id"]]
        # The reader refuses segments that do not meet.
        table = read("oem", path.read_text(), scene.epoch_us)
        assert np.isfinite(table.position_m).all()
        edges_s = np.array(
            [table.time_s[table.run == number][[0, -1]] for number in np.unique(table.run)]
        )
        own_s = burns_s[np.isfinite(burns_s).all(axis=1)]
        # Every second segment is a burn; between two burns, and after the last, it is a flight
        # without.
        np.testing.assert_allclose(edges_s[0::2], own_s, atol=6e-7)
        counts.append(len(list(OrbitEphemerisMessage.open(path))))
    assert counts == [2 * np.isfinite(burns_s[:, 0]).sum() for burns_s in run.plan.targets.burns_s]
    assert max(counts) > 2


def test_objects_and_steps_can_be_chosen(tmp_path: Path) -> None:
    files = exported(
        short_run(), "oem", tmp_path / "out", "objects=targets", "burn_step_s=5", "frame=ITRF-97"
    )
    assert {path.stem.removeprefix("target-") for path in files} == set(short_run().target_ids)
    burn, flight = OrbitEphemerisMessage.open(files[0])
    assert {stretch.metadata["REF_FRAME"] for stretch in (burn, flight)} == {"ITRF-97"}
    start, second = list(burn)[:2]
    assert (second.epoch - start.epoch).sec == pytest.approx(5.0, abs=1e-6)


@pytest.mark.slow
def test_measured_angles_are_those_of_the_detections(tmp_path: Path) -> None:
    rows = first_seconds().detections
    run = first_seconds()
    angles = rows.angles()
    count = 0
    for segment in tracking_data(tmp_path):
        meta = segment.metadata
        sensor = [candidate.id for candidate in run.sensors].index(meta.participant_1)
        track = (
            -1
            if meta.participant_2 == "UNCORRELATED"
            else int(meta.participant_2.removeprefix("TRACK-"))
        )
        members = np.flatnonzero((rows.sensor == sensor) & (rows.track == track))
        members = members[np.argsort(rows.time_ns[members], kind="stable")]
        azimuth = observations(segment, "angle_1")
        elevation = observations(segment, "angle_2")
        np.testing.assert_allclose(azimuth[0], rows.time_s[members], atol=6e-7)
        np.testing.assert_allclose(azimuth[1], np.degrees(angles.azimuth_rad[members]), atol=1e-9)
        np.testing.assert_allclose(
            elevation[1], np.degrees(angles.elevation_rad[members]), atol=1e-9
        )
        count += len(members)
    assert count == len(rows)


def observations(segment: Any, name: str) -> tuple[np.ndarray[Any, Any], list[float]]:
    """Return times, scene seconds, and values, degrees, of one kind of observation of a segment."""
    values = [value for value in segment.data.observation if getattr(value, name) is not None]
    return scene_seconds([value.epoch for value in values]), [
        getattr(value, name).value for value in values
    ]


@pytest.mark.slow
def test_right_ascension_is_that_of_erfa(tmp_path: Path) -> None:
    run = first_seconds()
    rows = run.detections
    first_sensor = None
    segments = tracking_data(tmp_path, "angles=radec", "objects=targets")
    assert {item.metadata.participant_2 for item in segments} <= {*run.target_ids, "UNCORRELATED"}
    for segment in segments:
        assert segment.metadata.reference_frame.value == "EME2000"
        sensor = [item.id for item in run.sensors].index(segment.metadata.participant_1)
        target = run.target_ids.index(segment.metadata.participant_2)
        members = np.flatnonzero((rows.sensor == sensor) & (run.truth.target == target))
        members = members[np.argsort(rows.time_ns[members], kind="stable")][:20]
        utc = erfa.dtf2d("UTC", 2026, 4, 1, 12, 0, 0.0)
        at = utc[1] + rows.time_s[members] / 86400.0
        tt = erfa.taitt(*erfa.utctai(utc[0], at))
        # Equinox of 1976 and 1980, as EME2000 is defined; UT1 is UTC in opir.
        celestial = erfa.pnm80(*tt)
        sidereal = erfa.gst94(utc[0], at)
        line = rows.line_of_sight_ecef[members]
        turned = np.stack(
            [spun(angle, vector) for angle, vector in zip(sidereal, line, strict=True)]
        )
        expected = np.einsum("nji,nj->ni", celestial, turned)
        ra, dec = (
            np.radians(observations(segment, name)[1][:20]) for name in ("angle_1", "angle_2")
        )
        sight = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
        assert np.degrees(np.abs(sight - expected).max()) * 3600.0 < 2.0
        first_sensor = sensor
    assert first_sensor is not None


def spun(angle: float, vector: Any) -> Any:
    """Return an Earth-fixed vector in the frame of the true equator and equinox, by apparent
    sidereal time.
    """
    return erfa.rz(-angle, np.eye(3)) @ vector
