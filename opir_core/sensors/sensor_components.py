"""The components of a constellation package: sensor models that are data, and fleets of them.

A package declares its configuration classes (`with_defaults`) and yields what these functions
return. The sensor itself is imported when it is built.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from attrs import fields

from opir_core.host.components import Constellation, SensorModel
from opir_core.scene.fields import BANDS, BIAS, BODIES, RESIDUAL, STRUCTURE
from opir_core.sensors.scanning_sensor import DISCRIMINATION_WORDS, ScanningSensorConfig

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import SensorContext
    from opir_core.interfaces.sensors import Sensor

Presets = Mapping[str, Mapping[str, Any]]


def scanning_sensor(
    config: ScanningSensorConfig,
    context: "SensorContext",
    *,
    type: str,  # noqa: A002 - the field of the Sensor that is made
) -> "Sensor":
    """Return the sensor of a configuration; `type` is the class of the sensor in events."""
    from opir_core.sensors.built_sensor import built_sensor

    return built_sensor(config, context, type)


def scanning_model(
    name: str,
    summary: str,
    config: type[ScanningSensorConfig],
    presets: Presets | None = None,
    label: str = "",
    *,
    presets_for: Mapping[str, str] | None = None,
    subject: str = "",
) -> SensorModel:
    """Return the sensor model of a configuration class; `label` (`name`) is the `type` of its
    sensors in events.

    `summary` says what no setting says; the description goes on with the defaults. `presets`,
    `presets_for` and `subject` are as in `Component`.
    """
    return SensorModel(
        name=name,
        summary=f"{summary}: {scanning_words(config)}",
        config=config,
        build=partial(scanning_sensor, type=label or name),
        presets=presets or {},
        presets_for=presets_for or {},
        subject=subject,
        reads=_subjects_read,
    )


def scanning_words(config: type[ScanningSensorConfig]) -> str:
    """Return a sensor's defaults in words: `staring, 0.1 s; SWIR 2.5-3, MWIR 4-5 um; weighed by
    likelihood`.
    """
    defaults = {setting.name: setting.default for setting in fields(config)}
    bands = [
        f"{name} {low_um:g}-{high_um:g}" for name, (low_um, high_um) in defaults["bands"].items()
    ]
    rule = DISCRIMINATION_WORDS[defaults["spectral_discrimination"]]
    period_s = 1e-3 * defaults["scan_period_ms"]
    words = f"{defaults['scan_pattern']}, {period_s:g} s; {', '.join(bands)} um"
    return f"{words}; {rule}" if len(bands) > 1 else words


def _subjects_read(config: ScanningSensorConfig) -> Sequence[str]:
    """Return the subjects that a scanning sensor reads."""
    subjects = [BANDS, RESIDUAL if config.focal_plane is None else STRUCTURE]
    subjects += [BODIES] if config.follows_bodies else []
    subjects += [BIAS] if config.line_of_sight_bias_sigma_urad else []
    return subjects


def geostationary_fleet(model: str, summary: str, slots_deg: Iterable[float]) -> Constellation:
    """Return the constellation with the name of its sensor model: satellites MODEL-1, ... in slots,
    deg east.
    """
    satellites = [
        {"id": f"{model}-{number}", "orbital_slot_deg": slot}
        for number, slot in enumerate(slots_deg, 1)
    ]
    return Constellation(name=model, summary=summary, model=model, satellites=satellites)
