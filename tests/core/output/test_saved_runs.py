"""A run read back from its files is the run in memory, as far as files round."""

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import evidence_of_run, scorecard, scorecard_text
from two_sides import two_sides_plan
from written_regions import as_written

import opir_core
from opir_core import ImpactRegion, run_of_plan
from opir_core.cli.main import main
from opir_core.errors import ModelError, PluginError, SceneError
from opir_core.output import deliver, read_run
from opir_core.output.run_files import TRUTH_DECIMALS
from opir_core.plugin import Host, RunView, hookimpl

SCENE = Path(__file__).parents[3] / "tests" / "scenes" / "pacific_test_range.yaml"
#: The files of a run beside its events.
BESIDE = ("truth", "tracks", "manifest")
#: All its three targets burn by then.
CHANGES = ["duration_s=90", "tracker=imm"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run_folder = tmp_path_factory.mktemp("saved")
    words = [word for change in CHANGES for word in ("--set", change)]
    assert (
        main(["run", str(SCENE), *words, "--out", str(run_folder / "events.jsonl"), "--quiet"]) == 0
    )
    return run_folder


@pytest.fixture(scope="module")
def memory() -> opir_core.Run:
    return opir_core.simulate(opir_core.load_scene(SCENE, overrides=CHANGES))


@pytest.fixture(scope="module")
def saved(folder: Path) -> opir_core.Run:
    return opir_core.load_run(folder)


@pytest.mark.slow
def test_columns_are_those_of_the_run(saved: opir_core.Run, memory: opir_core.Run) -> None:
    actual = saved.detections
    expected = memory.detections
    for name in ("sensor", "detection_id", "reported_type", "bands", "detection_count", "track"):
        assert np.array_equal(getattr(actual, name), getattr(expected, name)), name
    assert np.abs(actual.time_ns - expected.time_ns).max() <= 1_000
    assert np.abs(actual.sensor_ecef_m - expected.sensor_ecef_m).max() <= 0.051
    assert np.abs(actual.line_of_sight_ecef - expected.line_of_sight_ecef).max() < 1.3e-9
    assert np.allclose(actual.confidence, expected.confidence, atol=5.1e-5)
    assert np.allclose(actual.snr, expected.snr, atol=5.1e-3, equal_nan=True)
    assert (actual.scan == -1).all()


@pytest.mark.slow
def test_truth_and_tracks_are_those_of_the_run(saved: opir_core.Run, memory: opir_core.Run) -> None:
    assert np.array_equal(saved.truth.target, memory.truth.target)
    actual = saved.truth
    expected = memory.truth
    columns = {"emission_s": "emission_time_s", "target_elevation_rad": "target_elevation_rad"}
    for key, decimals in TRUTH_DECIMALS.items():
        name = columns.get(key, key)
        half = 0.51 * 10.0**-decimals
        assert np.allclose(
            getattr(actual, name), getattr(expected, name), rtol=1e-15, atol=half, equal_nan=True
        ), name
    assert len(saved.tracks) == len(memory.tracks) > 0
    assert np.array_equal(saved.tracks.state, memory.tracks.state)


@pytest.mark.slow
def test_the_summary_is_counted_anew(saved: opir_core.Run, memory: opir_core.Run) -> None:
    assert saved.summary["counts"] == memory.summary["counts"]
    actual = saved.summary["targets"]
    expected = memory.summary["targets"]
    assert [row["first_sensor_id"] for row in actual] == [
        row["first_sensor_id"] for row in expected
    ]
    assert [row["latency_s"] for row in actual] == pytest.approx(
        [row["latency_s"] for row in expected], abs=1e-6
    )


def test_saved_hypotheses_ends_and_sources_are_those_of_the_run(
    tmp_path: Path,
) -> None:
    plan = two_sides_plan(
        duration_s=20.0, outputs=[{"jsonl": {"path": str(tmp_path / "events.jsonl")}}]
    )
    paths = {
        f"{kind}_path": tmp_path / f"events.{kind}.json{'' if kind == 'manifest' else 'l'}"
        for kind in BESIDE
    }
    deliver(plan, **paths)
    saved = opir_core.load_run(tmp_path, plan.host)
    memory = run_of_plan(plan)
    for name in (
        "hypothesis_probability",
        "probability_launch",
        "probability_missile",
        "probability_orbit",
        "end",
    ):
        assert np.array_equal(getattr(saved.tracks, name), getattr(memory.tracks, name)), name
    assert saved.tracks.hypothesis_probability.shape == (40, len(plan.hypotheses))
    assert saved.summary["tracks"] == memory.summary["tracks"]
    (actual,), (expected,) = saved.summary["sources"], memory.summary["sources"]
    assert actual == pytest.approx(expected, abs=5.1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["events.jsonl", "events.manifest.json", "events.truth.jsonl", "events.tracks.jsonl"]
)
def test_any_file_of_the_run_will_do(folder: Path, saved: opir_core.Run, name: str) -> None:
    assert repr(opir_core.load_run(folder / name)) == repr(saved)


class Views:
    """A plugin with views of a run."""

    @hookimpl
    def opir_run_views(self) -> Iterable[RunView]:
        yield RunView(
            name="map", summary="a picture", build=lambda run: f"<svg>{run.plan.scene.name}</svg>"
        )
        yield RunView(name="broken", summary="fails", build=lambda run: run.plan.scene.name / 2)


def with_host(run: opir_core.Run, *plugins: object) -> opir_core.Run:
    """Return a run with a host that allows no installed plugin."""
    host = Host.discover([])
    for plugin in plugins:
        host.register(plugin)
    return evolve(run, plan=evolve(run.plan, host=host))


def test_a_run_shows_itself_in_a_line(memory: opir_core.Run) -> None:
    assert len(repr(memory)) < 200
    assert memory.plan.scene.name in repr(memory)
    html = with_host(memory)._repr_html_()
    assert "<table>" in html
    assert "<svg>" not in html


def test_a_notebook_shows_the_map_that_a_plugin_offers(memory: opir_core.Run) -> None:
    html = with_host(memory, Views())._repr_html_()
    assert "<table>" in html
    assert f"<svg>{memory.plan.scene.name}</svg>" in html


@pytest.mark.slow
@pytest.mark.parametrize("encoder", ["forge-bands", "forge-tracks", "forge"])
def test_events_of_each_kin_of_forge_are_read(tmp_path: Path, encoder: str) -> None:
    settings = ["detection=snr", "classification=spectral", "duration_s=120"]
    output = f"outputs=[{{jsonl: {{path: {tmp_path}/e.jsonl, encoder: {encoder}}}}}]"
    options = [word for setting in (output, *settings) for word in ("--set", setting)]
    assert main(["run", str(SCENE), *options, "--quiet"]) == 0
    run = opir_core.load_run(tmp_path / "e.jsonl")
    memory = opir_core.simulate(opir_core.load_scene(SCENE, overrides=settings))
    assert len(run.detections) == len(memory.detections) > 0
    assert np.allclose(
        run.detections.type_probability, memory.detections.type_probability, atol=5.1e-5
    )
    if encoder == "forge-bands":
        expected = memory.detections.band_irradiance_w_m2
        assert np.allclose(run.detections.band_irradiance_w_m2, expected, rtol=1e-5, equal_nan=True)


def test_a_folder_without_one_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"is no folder of one run \(manifests in it: none\)"):
        opir_core.load_run(tmp_path)


def copied(folder: Path, place: Path) -> None:
    """Copy the files of a run."""
    for path in folder.iterdir():
        (place / path.name).write_bytes(path.read_bytes())


@pytest.mark.slow
@pytest.mark.parametrize("zone", ["+02:00", "Z+02:00"])
def test_times_of_another_zone_are_refused(folder: Path, tmp_path: Path, zone: str) -> None:
    copied(folder, tmp_path)
    events = tmp_path / "events.jsonl"
    text = re.sub(r'("timestamp":"[^"]*)Z"', rf'\1{zone}"', events.read_text(), count=1)
    events.write_text(text)
    with pytest.raises(SceneError, match="timestamp: is not a timestamp of opir, in UTC with Z"):
        read_run(events)


@pytest.mark.slow
def test_an_id_that_is_none_is_refused(folder: Path, tmp_path: Path) -> None:
    copied(folder, tmp_path)
    for name in ("events.jsonl", "events.truth.jsonl"):
        text = (tmp_path / name).read_text()
        first_id = json.loads((folder / "events.jsonl").read_text().splitlines()[0])["detection_id"]
        (tmp_path / name).write_text(text.replace(first_id, "never"))
    with pytest.raises(SceneError, match="detection_id: 'never' is not a UUID"):
        read_run(tmp_path / "events.jsonl")


@pytest.mark.parametrize(
    ("wanted", "view", "package"),
    [
        ("run.plot", lambda run: run.plot, "opir-report"),
        ("run.tables()", lambda run: run.tables(), "opir-export"),
        ("run.to_pandas()", lambda run: run.to_pandas(), "opir-export"),
        ("run.to_polars()", lambda run: run.to_polars(), "opir-export"),
    ],
)
def test_a_missing_view_is_refused_with_its_package(
    memory: opir_core.Run, wanted: str, view: Callable[[opir_core.Run], object], package: str
) -> None:
    with pytest.raises(PluginError) as refused:
        view(with_host(memory))
    assert str(refused.value).startswith(f"{wanted}: no run view is named")
    assert f"{package} provides it; from a clone of opir: python -m pip install ./plugins/" in str(
        refused.value
    )


def test_a_run_of_given_plugins_is_shown_by_what_is_installed(memory: opir_core.Run) -> None:
    pytest.importorskip("opir_export", reason="needs opir-export")
    assert "detections" in evolve(memory, plan=evolve(memory.plan, host=Host.of())).tables()


def test_a_view_that_fails_is_refused_with_its_owner(memory: opir_core.Run) -> None:
    with pytest.raises(
        ModelError, match=r"run.view\('broken'\): the run view 'broken' of plugin Views .*TypeError"
    ):
        with_host(memory, Views()).view("broken")


#: A number in the words of a scorecard.
NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?"


def radius_m(region: ImpactRegion) -> float:
    """Return the radius of the circle of a region's area."""
    return float(np.sqrt(1e6 * region.area_km2 / np.pi))


def edge_distance_m(region: ImpactRegion, places: Any) -> Any:
    """Return the distances (n,) of places from the edges of a region, on its map."""
    chart = region.chart()
    points = chart.points(places)
    distances = []
    for ring in (ring for polygon in region.polygons for ring in polygon):
        corners = chart.points(ring)
        along = np.diff(corners, axis=0)
        off = points[:, None] - corners[None, :-1]
        square = np.maximum(np.sum(along**2, axis=1), 1e-9)
        share = np.clip(np.sum(off * along, axis=2) / square, 0.0, 1.0)
        distances.append(np.hypot(*np.moveaxis(off - share[..., None] * along, 2, 0)).min(axis=1))
    return np.min(distances, axis=0)


@pytest.mark.slow
def test_regions_and_scores_are_those_of_the_run(
    saved: opir_core.Run, memory: opir_core.Run
) -> None:
    rng = np.random.default_rng(44)
    point_count = 0
    for was, current in zip(
        memory.tracks.impact_regions.tolist(), saved.tracks.impact_regions.tolist(), strict=True
    ):
        for region, back in zip(was, current, strict=True):
            corners = np.concatenate([ring for polygon in region.polygons for ring in polygon])
            places = corners[rng.integers(len(corners), size=4)] + rng.normal(0.0, 0.01, (4, 2))
            # The file's outlines are within 1 % of the radius; nearer places may change sides.
            places = places[edge_distance_m(region, places) > 0.01 * radius_m(region)]
            assert [region.contains(*place) for place in places] == [
                back.contains(*place) for place in places
            ]
            point_count += len(places)
    assert point_count > 100
    # An energy score of regions that nearly coincide depends on their outlines: those of the file.
    written = evolve(memory, tracks=memory.tracks.replaced(impact_regions=as_written(memory)))
    cards = [scorecard([evidence_of_run(run, run.plan)]) for run in (written, saved)]
    texts = [scorecard_text({"imm": card}) for card in cards]
    words = [re.sub(NUMBER, "#", text).split() for text in texts]
    assert words[0] == words[1]
    # Files round states and covariances: what is close to half a last digit of a score falls to the
    # other side.
    numbers = [[float(number) for number in re.findall(NUMBER, text)] for text in texts]
    assert len(numbers[0]) > 100
    assert numbers[0] == pytest.approx(numbers[1], rel=2e-4, abs=0.011)
