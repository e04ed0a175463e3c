"""The pages `explanation/what-is-modelled.md` and `explanation/what-is-left-out.md`, and the table
of all defaults.

The two pages list the same parts of the simulation. Defaults come from the components themselves:
the page shows the headline settings of the sensors, `explanation/defaults.csv` has every default
with its source.
"""

import csv
import io
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from opir_core.host.components import CATALOGUE, Component
from opir_core.host.host import Host
from opir_core.reading.scene_schema import SceneFile
from opir_core.scene.field_rows import FieldRow, field_rows
from opir_core.scene.links import Links
from opir_core.scene.scene import SceneDrag, SpoolConfig


class Part(NamedTuple):
    """One part of the simulation: computed, tabulated or notional; its model; what it omits and the
    error of that.
    """

    subject: str
    how: str
    model: str
    left_out: str
    error: str


PARTS = (
    Part(
        "Black and grey bodies",
        "computed",
        "Planck's law; in-band integrals accurate to 1e-12",
        "emissivity that varies within a band",
        "Signal is proportional to the mean emissivity of the band",
    ),
    Part(
        "Plume intensity in SWIR, MWIR and LWIR",
        "notional",
        "gases: table of in-band radiant intensity by class (`plumes.json`), chosen within 0.1 to 1"
        " % of jet power over"
        " 4π; to these add the particles",
        "any real vehicle; differences within a class; flicker",
        "No accuracy is claimed: the range that the table was chosen from spans a factor of 10; computed"
        " jets have ten times its SWIR in the median, and 10 to 100 times its LWIR. Set"
        " `scale` or"
        " `peak_w_sr` of the signature",
    ),
    Part(
        "Plume intensity in other bands, particles",
        "notional",
        "gases: a grey continuum that LWIR sets, hot H₂O and CO₂ near 2.7 and 4.3 µm, and in bands"
        " from 5 to 14 µm, other than LWIR itself, in jets that mix with the air (NASA SP-3080). By"
        " [propellant](radiometry.md#propellants) soot or alumina: a stated share of jet power with"
        " a stated spread",
        "spectral lines; gas bands near 2.0 µm and beyond 14 µm; exhaust more than 10 km behind,"
        " which glows for minutes in the bands of water (Geophys. Res. Lett. 30(15), 2003); from 5"
        " to 14 µm burns against the flight, nozzles side by side, hot staging; soot of single"
        " engines; alumina that emits more in long waves",
        "Kerosene: a factor of 3, held against GOES-16. Solid: a factor of 4. From 5 to 14 µm: a"
        " factor of 3, which holds 83 of 89 sightings; three of Starship at 75 km are off by more",
    ),
    Part(
        "Plume against altitude, stage and aspect",
        "notional",
        "gases: afterburning up to about 50 km, minimum at 70 to 90 km (Forden), recovery in"
        " vacuum; soot ends with"
        " afterburning, alumina does not; stages of the flight, or equal shares of a single burn;"
        " projected area of a"
        " slender body",
        "chemistry; plume structure; obscuration by the body; thrust tail-off; residual flame in"
        " gaps between stages",
        "Not estimated. Plumes are fully bright up to the end of a burn, and dark in gaps at once",
    ),
    Part(
        "Bodies after burnout",
        "notional",
        "grey body that reflects sunlight as a diffuse sphere, with the Earth's umbra and penumbra"
        " ([the Sun](sun.md)), and that the air heats:"
        " [nose, windward and lee side in radiative equilibrium](radiometry.md#bodies-in-the-air)."
        " [A nozzle cools](radiometry.md#bodies-in-the-air) by radiation after the burn. Every sensor"
        " looks at gliders, those with `follows_bodies` at all bodies; `spent_stages` fall by"
        " themselves",
        "earthshine; gloss and spin; albedo that differs from band to band; which side a sensor"
        " sees; in the air conduction, ablation, wakes, glowing air and plasma"
        " lines; break-up, residual propellant, the push of separations; with"
        " `forces: kepler` the drag of re-entry",
        "LWIR: earthshine adds at most about 10 % at emissivity 0.9. In the air: flow turns turbulent"
        " somewhere between Reynolds numbers of 3e5 and 1e7, where light is off by up to a factor of"
        " 3. Shapes are notional",
    ),
    Part(
        "Fires and gas flares",
        "computed",
        "grey bodies; temperatures from the literature, areas and emissivities notional",
        "smoke; flame structure; band emission of hot gases",
        "Not estimated. Signal too low near 2.7 and 4.3 µm",
    ),
    Part(
        "Aircraft, ships, trains, balloons, satellites, fire fronts",
        "notional",
        "[courses](moving-sources.md) over the ellipsoid in closed form; grey tailpipes, flames,"
        " funnels and spheres in sunlight",
        "skin; the gas behind dry engines; sunlight on aircraft; how fire spreads",
        "Not estimated; light within an order of magnitude",
    ),
    Part(
        "Lightning; bodies that enter the air, meteors that graze it",
        "computed",
        "[flashes](moving-sources.md) with published rates, strokes, durations and energies; free"
        " fall with J2 and drag, and stagnation heating of a nose; fragments of a break-up are like"
        " the body; sizes and the temperature of flashes notional",
        "flashes: pulses of half a millisecond, absorption in clouds, lines, the path; bodies:"
        " break-up but by `fragments`, ablation, glowing air and wakes",
        "Flashes: energies in the optical are published; near 2.7 µm clouds take most of them: too"
        " bright. A real break-up flares, and takes place between 70 and 80 km",
    ),
    Part(
        "Sun glint",
        "computed",
        "Cox and Munk slope statistics, Fresnel reflectance, the Sun as a black disc, the scene's"
        " atmosphere on the"
        " way down",
        "wind direction; shadowing; whitecaps; refractive index by wavelength; in the background a"
        " map of land and sea,"
        " and structure",
        "Not estimated. Too bright where the sensor is low above the sea's horizon",
    ),
    Part(
        "Bolides",
        "notional",
        "grey body on a straight path at constant speed; flash as sin² in time",
        "ablation; fragmentation; drag; measured light curves",
        "No accuracy is claimed",
    ),
    Part(
        "Atmospheric transmittance",
        "tabulated",
        "LOWTRAN7 band means for six climates, zenith to horizon. Interpolation error 0.003 at 360"
        " places ([benchmark](../benchmarks/atmosphere.md)). Limb paths: for targets up to 100 km, by"
        " the lowest height of the straight path, 2.5 km and above; below, as at 2.5 km. Error 0.008"
        " at 360 places",
        "coincidence of hot gas lines with cold absorption lines; weather; change of trace gases"
        " since 1986; refraction below 2.5 km, where rays can meet the ground",
        "Lines: not estimated, transmittance too high for plumes. Gases: 30 % more CO₂ lowers a"
        " transmittance by at most 0.10. Limb below 2.5 km: not estimated, too high",
    ),
    Part(
        "Cloud",
        "notional",
        "thin opaque deck at one height, everywhere or in independent cells of a stated cover",
        "thickness; partial transmittance; motion; shapes and sizes of real cloud",
        "A target is either visible or hidden. Delay until it is above the deck: [first"
        " detections](../benchmarks/first_detection.md)",
    ),
    Part(
        "Background radiance of the Earth",
        "tabulated",
        "LOWTRAN7 by night and by day in six climates, three kinds of cloud, a formula for opaque"
        " cloud; linear in the sines of elevation. Beyond the limb the air's own radiance, by the"
        " height of the tangent",
        "albedo other than 0.1; twilight; daytime excess near 4.3 µm (non-LTE); sunlight beyond the"
        " limb, and non-LTE above 60 km",
        "4.3 µm by day: up to 10 K (DeSouza-Machado et al., 2007), 50 to 60 % of the radiance. The"
        " rest is not"
        " estimated. It changes only the noise: photon noise as √L, clutter as L",
    ),
    Part(
        "Clutter",
        "notional",
        "sensors with a `focal_plane`: power spectrum of cloud, surface and limb through filters"
        " and frame difference"
        " ([how](focal-plane.md)). Others: `clutter_residual`, a fixed share of the radiance",
        "correlation between the looks at a target; foreshortening towards the limb; non-Gaussian"
        " tails; motion of"
        " clouds; structure by place and season",
        "Correlation: [how many looks count](focal-plane.md#from-look-to-look). Tails: false alarms"
        " of real clutter are"
        " more frequent and come in groups",
    ),
    Part(
        "Detection",
        "computed",
        "Gaussian noise (NEI, photons, clutter) against a threshold; rules over bands; noise-only"
        " false alarms",
        "without a `focal_plane`: point spread, saturation, image motion; always: blooming, the"
        " phase of a source on"
        " its pixel, its own photon noise",
        "With a `focal_plane`: P_d off by 0.01 in the median of 48 settings, by 0.10 at most"
        " ([images](../benchmarks/focal_plane.md)). Without: source at the corner of four cells, up"
        " to three quarters"
        " of the signal",
    ),
    Part(
        "Type from measured irradiance",
        "computed",
        "Bayes' rule over simulated launches and hot sources, through the scene's atmosphere and"
        " sensors; priors and"
        " spreads notional",
        "correlation between looks at one launch; signatures that a scene sets for its targets",
        "Probabilities of several looks must not be multiplied",
    ),
    Part(
        "Boost and ballistic flight",
        "computed",
        "notional class profiles or [gravity turns](gravity-turn.md) of notional stages on the"
        " rotating ellipsoid, then"
        " a two-body arc (default), or J2 to J4 and drag (`forces`)",
        "thrust, mass and staging of any vehicle; with the default `forces: kepler`, oblateness and"
        " drag",
        "Impact from the same burnout state, median (largest). J2: ICBM 14 km (61 km), SRBM 0.7 km"
        " (2.8 km). Drag:"
        " SRBM 4 km (18 km), ICBM 0.7 km (3 km)",
    ),
    Part(
        "Glide, and insertion into orbit",
        "computed",
        "HGV: equilibrium glide at a constant lift-to-drag ratio (Eggers, Allen and Neice, 1957) in"
        " an exponential"
        " atmosphere, then free fall. SLV: one burn that ends in a circular orbit. Both on notional"
        " class profiles",
        "HGV: the Earth's rotation during the glide; phugoid motion, manoeuvres, the dive."
        " SLV: coast phases,"
        " several burns",
        "Rotation, eastwards on the equator at 5 km/s: the glider carries 8 % of its weight less,"
        " so it glides farther;"
        " the rest is not estimated",
    ),
    Part(
        "Sensor orbits; Sun outages and eclipses",
        "computed",
        "two-body motion or SGP4; Sun to 0.001°, ellipsoid without air, umbra and penumbra; the"
        " exclusion angle is notional ([the Sun](sun.md))",
        "two-body: oblateness, Moon and Sun. SGP4: UT1 and polar motion. Stray light beyond the"
        " exclusion angle; refraction; the Moon; trackers do not know of outages",
        "Two-body: a few km in the first revolution of a low orbit, hundreds of m a day at"
        " geostationary distance. [All figures](../reference/orbits.md). Edges of outages: 0.2 s"
        " against astropy, and up to 0.9 s where UT1 differs from UTC. Air at the limb: not"
        " estimated",
    ),
    Part(
        "Line of sight",
        "computed",
        "straight line over WGS 84 with light time; Gaussian error and constant bias",
        "refraction",
        "From geostationary distance, target on the ground: 5 µrad at 5° elevation, 1.6 µrad at"
        " 10°, 0.1 µrad at 40°",
    ),
)

MODELLED = """# What is modelled

*Which part of the simulation is physics, which is a table, and which is made up?* Generated by
`python docs/generate.py`.

Every part of the simulation carries one of three labels:

- **computed**: follows from stated physics;
- **tabulated**: interpolated in shipped tables of known origin;
- **notional**: made up; plausible, adjustable, and no real system's value.

```text
target, source -> signature -> atmosphere -> aperture -> detection -> type
   computed       notional      tabulated    computed    computed   computed
```

What each part omits, and the size of the error, is on the page [What is left out](what-is-left-out.md).

## Parts of the simulation

| part | label | model |
|---|---|---|
{parts}

## Defaults

All {count} defaults of components, scenes, outputs and the service, each with its source, are in
[defaults.csv](defaults.csv) (columns: component, key, default, source). {notional} of them are notional without a
source; {paper} come from the [paper](paper-errata.md) at least in part. Noise-equivalent irradiance (NEI), IFOV and
line-of-sight error of sensors are notional. The page of
[components](../reference/components.md) has the same defaults with units and ranges, and the values of every preset.
A default of `none` sets nothing and is not listed.
"""

LEFT_OUT = """# What is left out

*How far can I trust a result?* This page lists what each part of the simulation omits and how large the error is.
Generated by `python docs/generate.py`. The models themselves are on the page [What is modelled](what-is-modelled.md).

Where the error is "not estimated", the table gives its sign if that is known. Absolute ranges, times of first detection
and false-alarm rates are not those of a real system: signatures and sensor noise are notional. Differences between two
runs that share these values follow from the physics.

| part | left out | error |
|---|---|---|
{parts}

How the figures were obtained:

- *Forces.* 300 launches of each class over random ranges (at most 12 000 km), propagated from the same burnout state:
  `kepler` against `j2`, and `j2` against `[j2, drag]` with 5 000 kg/m². J3 and J4 move an impact by at most 0.2 km. Aim
  points are reached under the forces of the scene, so a scene's impacts do not move.
- *Refraction.* Ray through spherical shells, refractivity 2.73e-4 at the ground and scale height 8.4 km.
- *CO₂.* Optical depth scaled by 1.3. *Earthshine.* Earth radiance at 8 to 12 µm on a body of reflectance 0.1 at 300 K.
"""


def modelled_pages(host: Host) -> Mapping[str, str]:
    """Return both pages and the table of defaults by file name."""
    rows = list(_defaults(host))
    sources = [row[3] for row in rows]
    modelled = MODELLED.format(
        parts=_table((part.subject, part.how, part.model) for part in PARTS),
        count=len(rows),
        notional=sources.count("notional"),
        paper=sum("paper (2026)" in source for source in sources),
    )
    left_out = LEFT_OUT.format(
        parts=_table((part.subject, part.left_out, part.error) for part in PARTS)
    )
    return {
        "what-is-modelled.md": modelled,
        "what-is-left-out.md": left_out,
        "defaults.csv": _csv(rows),
    }


def _defaults(host: Host) -> Iterator[tuple[str, str, str, str]]:
    """Yield component, key, default and source of every field that has a value by default."""
    for hook, kind in CATALOGUE.items():
        for name in host.names(hook):
            offered = host.component(hook, name)
            if isinstance(offered, Component):
                for row in _set(offered.config):
                    yield f"{kind.kind} {name}", row.key, row.default_text, row.source
    for name, config in _others().items():
        for row in _set(config):
            yield name, row.key, row.default_text, row.source


def _others() -> Mapping[str, type]:
    """Return the configuration classes that belong to no component, by what they set."""
    from opir_http.settings import HttpSettings
    from opir_readers.orbits.fleet_config import FleetConfig
    from opir_studies import Study

    return {
        "scene": SceneFile,
        "forces: [{drag: ...}]": SceneDrag,
        "links": Links,
        "sensors: [{fleet: ...}]": FleetConfig,
        "output's spool": SpoolConfig,
        "opir serve": HttpSettings,
        "study": Study,
    }


def _set(config: type) -> Iterator[FieldRow]:
    """Yield the fields that have a value by default; fields below a block that is none by default
    have none.
    """
    unset: list[str] = []
    for row in field_rows(config):
        if row.default is None and not row.is_required:
            unset.append(f"{row.key}.")
        elif not row.is_required and not row.key.startswith(tuple(unset)):
            yield row


def _table(rows: Iterator[tuple[str, ...]]) -> str:
    return "\n".join(
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in rows
    )


def _csv(rows: list[tuple[str, str, str, str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [("component", "key", "default", "source"), *rows]
    )
    return text.getvalue()
