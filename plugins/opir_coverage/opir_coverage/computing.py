"""The coverage of a scene: its layers over a grid, from geometry to bounds at burnout."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import evolve

from opir_core import Host, Plan, Scene, compile_plan, load_scene
from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, install_command
from opir_core.planning import distinct_bands
from opir_coverage.geometry_layers import geometry_layers
from opir_coverage.grid import PlaceGrid
from opir_coverage.launch_layers import band_title, launch_layers, launch_times_s
from opir_coverage.layers import PLACES, CoverageMap, Layer
from opir_coverage.settings import CoverageSettings, Requirement

if TYPE_CHECKING:
    import xarray


#: Dimensions over which shares of requirements are taken.
_INSTANTS = ("time", "launch_time", "azimuth")


def coverage(scene: Scene | Plan | str | Path, **settings: Any) -> "xarray.Dataset":
    """Return the coverage of a scene as an `xarray.Dataset`.

    The settings are those of `CoverageSettings`. Raises `ModelError` for impossible settings, and
    without xarray.
    """
    try:
        return computed_coverage(scene, made_settings(**settings)).xarray()
    except ImportError as error:
        remedy = install_command("opir-coverage", "xarray")
        raise ModelError(f"opir_coverage.coverage needs xarray; {remedy}") from error


def made_settings(**settings: Any) -> CoverageSettings:
    """Return settings; raises `ModelError` for those that are not possible."""
    try:
        return CoverageSettings(**settings)
    except (TypeError, ValueError) as error:
        raise ModelError(str(error)) from error


def computed_coverage(scene: Scene | Plan | str | Path, settings: CoverageSettings) -> CoverageMap:
    """Return the coverage of a scene, of a file or of a plan."""
    plan = _plan_of(scene)
    if not plan.sensors:
        raise ModelError("the scene has no sensors, so nothing is covered")
    try:
        grid = PlaceGrid.of(settings.grid_deg)
    except ValueError as error:
        raise ModelError(f"--grid: {error}") from error
    layers, time_s = geometry_layers(plan, grid, settings)
    if settings.target_class is not None:
        layers += launch_layers(plan, grid, settings)
    dims = {name for layer in layers for name in layer.dims}
    coordinates = {
        name: values
        for name, values in _coordinates(plan, settings, time_s).items()
        if name in dims
    }
    coverage_map = CoverageMap(grid, coordinates, layers, _attributes(plan, settings))
    shares = [
        _share_layer(coverage_map, requirement, number)
        for number, requirement in enumerate(settings.requirements, start=1)
    ]
    return evolve(coverage_map, layers=[*layers, *shares])


def _plan_of(scene: Scene | Plan | str | Path) -> Plan:
    if isinstance(scene, Plan):
        return scene
    loaded = load_scene(scene) if isinstance(scene, str | Path) else scene
    return compile_plan(loaded, Host.discover())


def _coordinates(plan: Plan, settings: CoverageSettings, time_s: FloatArray) -> dict[str, Any]:
    """Return the coordinates of all dimensions by name."""
    return {
        "band": [band_title(band) for band in distinct_bands(plan.sensors)],
        "assets": list(settings.assets),
        "height": list(settings.heights_km),
        "azimuth": list(settings.azimuths_deg),
        "launch_time": launch_times_s(settings).tolist(),
        "time": time_s.tolist(),
    }


def _attributes(plan: Plan, settings: CoverageSettings) -> dict[str, str]:
    """Return scene, interval, sensors and launches of a coverage, as text."""
    from opir_core import __version__

    launched = settings.target_class or "none"
    epoch = datetime.fromtimestamp(plan.scene.epoch_us * 1e-6, tz=UTC)
    return {
        "title": f"Coverage of {plan.scene.name}",
        "scene": plan.scene.name,
        "epoch": f"{epoch:%Y-%m-%dT%H:%M:%SZ}",
        "interval": f"{settings.hours:g} h in {settings.steps} steps of"
        f" {3600.0 * settings.hours / settings.steps:g} s",
        "sensors": ", ".join(sensor.id for sensor in plan.sensors),
        "launches": f"{launched} {settings.profile}".strip(),
        "probability": f"{settings.chance:g}",
        "track": f"{settings.track_reports} reports",
        "source": f"opir {__version__}, opir-coverage",
    }


def _share_layer(coverage_map: CoverageMap, requirement: Requirement, number: int) -> Layer:
    try:
        layer = coverage_map[requirement.layer]
    except KeyError as error:
        raise ModelError(f"--require: {error.args[0]}") from error
    met = requirement.is_met(np.asarray(layer.values))
    axes = tuple(axis for axis, name in enumerate(layer.dims) if name in _INSTANTS)
    share = 100.0 * met.mean(axis=axes) if axes else 100.0 * met
    dims = tuple(name for name in layer.dims if name not in _INSTANTS)
    words = f"share of the instants (and azimuths) at which {requirement}"
    return Layer(
        f"share_{number}", f"Share of the day with {requirement}", "percent", dims, share, words
    )


__all__ = ["PLACES", "computed_coverage", "coverage", "made_settings"]
