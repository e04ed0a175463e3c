"""The page `explanation/what-is-modelled.md`: what opir computes, what it takes from tables, and what is notional.

The parts of the chain are told here; the defaults of every component come from the components themselves.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from opir_core.plugin.components import CATALOGUE, Component
from opir_core.plugin.description import FieldRow, field_rows
from opir_core.plugin.host import Host
from opir_core.scene.reading.scene_schema import SceneFile
from opir_core.scene.scene import SceneDrag
from opir_core.scene.spool_settings import SpoolConfig


class Part(NamedTuple):
    """One part of the chain: how opir has it (computed, tabulated or notional), from where, and what it leaves out."""

    subject: str
    how: str
    source: str
    left_out: str


PARTS = (
    Part(
        "Black and grey bodies",
        "computed",
        "Planck's law, in-band integrals to 1e-12 (`opir_core.radiometry.planck`)",
        "emissivity that changes within a band",
    ),
    Part(
        "Brightness of plumes in SWIR, MWIR and LWIR",
        "notional",
        "a table by class, `opir_core/data/plumes.json`, inside 0.1 to 1 % of jet power over 4π",
        "any vehicle; how plumes differ within a class; flicker",
    ),
    Part(
        "Plumes in other bands",
        "notional",
        "a rule: a grey continuum with all of LWIR, and what it leaves of SWIR and MWIR in the bands of hot H₂O and CO₂"
        " near 2.7 and 4.3 µm (`opir_core.radiometry.plume`)",
        "lines, the gases' other bands (near 2.0, 6.3 and 15 µm), particles' own spectra",
    ),
    Part(
        "Plumes with altitude, thrust phase, aspect",
        "notional",
        "afterburning to about 50 km, a trough at 70 to 90 km (Forden), recovery in vacuum; stages of equal shares of"
        " the burn; the area that a long body shows",
        "chemistry, plume structure, staging gaps, obscuration by the body",
    ),
    Part(
        "Bodies after burnout",
        "notional",
        "grey bodies of one temperature, for sensors that follow them",
        "heating on entry, sunlight and earthlight that they reflect, spin",
    ),
    Part(
        "Transmittance of the atmosphere",
        "tabulated",
        "LOWTRAN7 band means for five climates, from the zenith to the horizon, interpolated with an error of 1.3e-4 at"
        " its points and of 0.003 at 360 places between them, against LOWTRAN7 itself"
        " ([benchmark](../benchmarks/atmosphere.md))",
        "that lines of hot gas coincide with those of the cold air, which lets less through than the mean of the band;"
        " weather; gases since 1986",
    ),
    Part(
        "Long paths: across the limb, to sensors below the target's horizon",
        "tabulated",
        "LOWTRAN7 from heights up to 100 km, by the height to which a straight path would descend, 2.5 km and above:"
        " at 360 places between the table's points 0.008 off at most. Below 2.5 km optical depth grows along the path"
        " as it does there (`opir_core.radiometry.long_paths`)",
        "refraction below 2.5 km, where rays from afar bend into the ground; the air that paths from above 100 km dip"
        " into",
    ),
    Part(
        "Cloud",
        "notional",
        "a thin opaque deck at one height, everywhere or in independent cells of a stated cover",
        "thickness, partial transmittance, motion, the shapes and sizes of real cloud",
    ),
    Part(
        "Radiance of the Earth",
        "tabulated",
        "LOWTRAN7 by night and by day (Sun at 0, 30, 60, 80° from the zenith, nadir and 61.6°), three kinds of cloud,"
        " and opaque cloud by formula; straight between in the sines of elevation",
        "surfaces of albedo other than 0.1, twilight, the daytime excess at 4.3 µm beyond local equilibrium, radiance"
        " of the air beyond the limb (0 here)",
    ),
    Part(
        "Clutter",
        "notional",
        "a share of the background's radiance is left after subtraction, as if random in each look",
        "structure in space and time, jitter, line-of-sight dependence",
    ),
    Part(
        "Fires and gas flares",
        "computed",
        "grey bodies; temperatures from the literature, areas and emissivities notional",
        "smoke, flame structure, what the gases of a flame add in their bands",
    ),
    Part(
        "Sun glint",
        "computed",
        "Cox and Munk's slopes of water under wind, Fresnel's reflectance, the Sun as a black disc, its light through"
        " the scene's atmosphere on the way down",
        "the wind's direction, shadowing, whitecaps, refractive index by wavelength",
    ),
    Part(
        "Bolides",
        "notional",
        "a grey body that flashes as sin² in time on a straight way at constant speed",
        "ablation, fragmentation, drag, light curves of real ones",
    ),
    Part(
        "Types from measured light",
        "computed",
        "Bayes' rule over imagined launches of the class profiles, fires, flares, glints and bolides, through the"
        " scene's own air and sensors (`opir_core.classification`); priors and spreads are notional",
        "that looks at one launch are alike; what a scene sets of its own targets' signatures",
    ),
    Part(
        "Boosts and ballistic arcs",
        "computed",
        "generic class profiles on the rotating ellipsoid, two-body arcs or numerical propagation; the profiles are"
        " notional (`opir_core/data/class_profiles.json`)",
        "thrust, mass and staging of any vehicle",
    ),
)

INTRO = """# What is modelled, what is tabulated, what is notional

Generated by `python docs/generate.py`. opir is a simulator of generic sensors against generic targets. *Computed*
parts follow from stated physics, *tabulated* ones are interpolated in shipped tables of known origin, and what is
*notional* is made up: plausible, labelled, settable, and no real system's.

## The chain

| part | how | from where | what it leaves out |
|---|---|---|---|
"""

DEFAULTS = """
## Every default

Of each component that a scene may name, of the scene itself and of what runs it: its defaults, and where each comes
from or the word *notional*. Those that set nothing (`none`) are left out, and what stands below them. A preset's values
stand on the page of [components](../reference/components.md).

| component | key | default | source |
|---|---|---|---|
"""


def modelled_page(host: Host) -> str:
    """Return the page."""
    chain = "\n".join(f"| {' | '.join(_cell(cell) for cell in part)} |" for part in PARTS)
    return f"{INTRO}{chain}\n{DEFAULTS}{chr(10).join(_defaults(host))}\n"


def _defaults(host: Host) -> Iterator[str]:
    for hook, kind in CATALOGUE.items():
        for name in host.names(hook):
            offered = host.component(hook, name)
            if not isinstance(offered, Component):
                continue
            for row in _set(offered.config):
                source = _cell(row.source)
                yield f"| {kind.kind} `{name}` | `{row.key}` | `{_cell(row.default_text)}` | {source} |"
    for name, config in _others().items():
        for row in _set(config):
            yield f"| {name} | `{row.key}` | `{_cell(row.default_text)}` | {_cell(row.source)} |"


def _others() -> Mapping[str, type]:
    """Return the configuration classes that are no component's, by what they set."""
    from opir_http.settings import HttpSettings

    return {
        "a scene": SceneFile,
        "`forces: [{drag: ...}]`": SceneDrag,
        "an output's `spool`": SpoolConfig,
        "`opir serve`": HttpSettings,
    }


def _set(config: type) -> Iterator[FieldRow]:
    """Yield the fields that have a value by default."""
    unset: list[str] = []
    for row in field_rows(config):
        if row.default is None and not row.is_required:
            unset.append(f"{row.key}.")
        elif not row.is_required and not row.key.startswith(tuple(unset)):
            yield row


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
