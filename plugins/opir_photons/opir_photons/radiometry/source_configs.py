"""What a scene may set of sources that are no targets. Nothing heavy is imported here."""

from collections.abc import Mapping, Sequence
from typing import Any

from attrs import fields_dict, frozen

from opir_core.plugin import cited, nested, number, text, with_defaults
from opir_core.scene import QuadrangleConfig, info_of

_CNEOS = "median of 1044 events of CNEOS fireballs, 1988 to 2026"

#: Fields that each emitter may have of its own, in `at` or in a CSV; by default they are the block's.
OWN_FIELDS = ("height_m", "start_s", "end_s", "temperature_k", "emissivity", "area_m2")


PLACE_FIELDS = ("lat_deg", "lon_deg")


def emitter_complaint(emitter: Mapping[str, Any], block: "PlacedConfig") -> str | None:
    """Return the first error in one emitter's own values, by the fields of its block's
    configuration class.
    """
    kind = type(block)
    infos = {name: info_of(fields_dict(kind)[name]) for name in own_fields(kind)}
    infos |= {
        "lat_deg": info_of(fields_dict(QuadrangleConfig)["south_deg"]),
        "lon_deg": info_of(fields_dict(QuadrangleConfig)["west_deg"]),
    }
    complaint = names_complaint(tuple(emitter), kind)
    if complaint:
        return complaint
    for name, value in emitter.items():
        if not infos[name].accepts(value):
            return (
                f"{name}: {value!r} is outside {infos[name].interval} {infos[name].unit}".rstrip()
            )
    times_s = (emitter.get(name, getattr(block, name)) for name in ("start_s", "end_s"))
    return _times_complaint(*times_s)


def names_complaint(names: Sequence[str], kind: type) -> str | None:
    """Return the first error in the names of emitters' own fields."""
    fields = (*PLACE_FIELDS, *own_fields(kind))
    for name in names:
        if name not in fields:
            from difflib import get_close_matches

            similar = get_close_matches(name, fields, 1)
            if similar:
                return f"{name or repr(name)}: unknown; did you mean {similar[0]}?"
            return f"{name or repr(name)} is not one of {', '.join(fields)}"
    missing = [name for name in PLACE_FIELDS if name not in names]
    return f"{missing[0]} is missing" if missing else None


def _times_complaint(start_s: float, end_s: float | None) -> str | None:
    if end_s is None or end_s > start_s:
        return None
    return f"end_s {end_s:g} is not after start_s {start_s:g}"


def own_fields(kind: type) -> tuple[str, ...]:
    """Return the fields that an emitter may set itself, besides its place, in a block of this
    configuration class.
    """
    return tuple(
        name
        for name in (*OWN_FIELDS, *getattr(kind, "more_own_fields", ()))
        if name in fields_dict(kind)
    )


@frozen
class PlacesConfig:
    """Random places in a region: independent, their number by the law of Poisson."""

    region: QuadrangleConfig = nested(help="where")
    per_million_km2: float = number(
        minimum=0.0,
        help="expected number in a million km², and for what is brief in each hour",
        source="no default",
    )


@frozen
class FieldConfig(PlacesConfig):
    """A random field: emitters at random places, with random areas."""

    area_log_sigma: float = number(
        default=1.0,
        minimum=0.0,
        maximum=5.0,
        help="standard deviation of the natural logarithm of the areas, about the block's area",
    )


@frozen
class PlacedConfig:
    """What a scene may set of every kind of source: where, in one of three ways; the third is the
    `field` of a kind.
    """

    at: tuple[Mapping[str, float], ...] | None = nested(
        default=None,
        help="emitters, each with lat_deg, lon_deg and what it has of its own",
        source="no default: at, csv or field",
    )
    csv: str | None = text(
        default=None,
        help="a file of emitters, relative to the working directory: a header with lat_deg, lon_deg"
        " and own fields, an emitter a line, empty cells for the block's values",
        source="no default: at, csv or field",
    )

    def __attrs_post_init__(self) -> None:
        ways = [name for name in ("at", "csv", "field") if getattr(self, name) is not None]
        if len(ways) != 1:
            words = f"{' and '.join(ways)} are given" if ways else "none of them is given"
            raise ValueError(f"{words}; exactly one of at, csv and field is needed")
        times_s = (getattr(self, name) for name in ("start_s", "end_s"))
        complaint = None if self.at or self.csv else _times_complaint(*times_s)
        if complaint:
            raise ValueError(complaint)
        for number_, emitter in enumerate(self.at or ()):
            complaint = emitter_complaint(emitter, self)
            if complaint:
                raise ValueError(f"at[{number_}]: {complaint}")


@frozen
class SourceConfig(PlacedConfig):
    """What a scene may set of sources that are grey bodies: where, when, and how bright."""

    field: FieldConfig | None = nested(
        default=None, help="a random field", source="no default: at, csv or field"
    )
    height_m: float = number(
        default=0.0, unit="m", minimum=-500.0, maximum=150e3, help="height above the ellipsoid"
    )
    start_s: float = number(
        default=-10.0,
        unit="s",
        minimum=-86_400.0,
        help="scene time from which it shines",
        source="before the scene begins",
    )
    end_s: float | None = number(
        default=None,
        unit="s",
        help="scene time to which it shines",
        source="none: beyond the scene's end",
    )
    temperature_k: float = number(
        default=1000.0, unit="K", above=0.0, maximum=20_000.0, help="temperature of a grey body"
    )
    emissivity: float = number(default=1.0, above=0.0, maximum=1.0, help="emissivity")
    area_m2: float = number(
        default=1000.0, unit="m2", above=0.0, maximum=1e12, help="area that shines"
    )


@with_defaults(
    temperature_k=cited(
        1000.0,
        "flaming vegetation, 800 to 1200 K: Dozier, Remote Sensing of Environment 11 (1981),"
        " 221-229",
    ),
    emissivity=0.9,
    area_m2=2000.0,
)
class FireConfig(SourceConfig):
    """What a scene may set of `fires`: flat grey bodies, as bright as their area is wide to the
    sensor.
    """


@with_defaults(
    temperature_k=cited(
        1800.0, "gas flares, 1600 to 2000 K: Elvidge et al., Energies 9 (2016), 14"
    ),
    emissivity=0.3,
    area_m2=30.0,
    height_m=50.0,
)
class FlareConfig(SourceConfig):
    """What a scene may set of `flares`: grey bodies that shine alike to all sides; the area is that
    seen.
    """


@with_defaults(
    temperature_k=cited(5772.0, "the Sun's effective temperature, IAU 2015 resolution B3"),
    area_m2=1e6,
)
class GlintConfig(SourceConfig):
    """What a scene may set of `glints`: water that mirrors the Sun; `area_m2` is its surface,
    temperature the Sun's.
    """

    wind_m_s: float = number(
        default=5.0,
        unit="m/s",
        minimum=0.0,
        maximum=30.0,
        help="wind over the water, which roughens it",
    )
    refractive_index: float = number(
        default=1.33,
        above=1.0,
        maximum=5.0,
        help="of the surface, real",
        source="water in visible light",
    )


@with_defaults(
    temperature_k=4500.0,
    emissivity=1.0,
    area_m2=cited(670.0, f"6.2e10 J in two seconds at 4500 K; {_CNEOS}"),
    height_m=cited(47.4e3, f"brightest at 35.2 km after a second of the way down; {_CNEOS}"),
)
class BolideConfig(SourceConfig):
    """What a scene may set of `bolides`: meteors that flash along a straight way down; they shine
    to all sides.
    """

    more_own_fields = ("speed_m_s", "descent_deg", "heading_deg", "flash_s")

    speed_m_s: float = number(
        default=17_300.0,
        unit="m/s",
        minimum=0.0,
        maximum=72_000.0,
        help="speed relative to the Earth",
        source=_CNEOS,
    )
    descent_deg: float = number(
        default=45.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        help="angle of the way below the horizontal",
    )
    heading_deg: float = number(
        default=0.0, unit="deg", minimum=0.0, maximum=360.0, help="direction, from north over east"
    )
    flash_s: float = number(
        default=2.0,
        unit="s",
        above=0.0,
        maximum=60.0,
        help="how long it shines, from start_s on; brightest in the middle",
    )
