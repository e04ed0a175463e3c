"""The formats of flights of other programs that are read, and a small file of each."""

from typing import Any

from attrs import frozen

from opir_core.plugin import FileReader, ReaderContext, StateTable, deferred, nested, text
from opir_readers.configs_of_sites import SITE_HELP, SiteConfig, start_setting
from opir_readers.reader_calls import reads


@frozen
class RocketConfig:
    """The settings of exports of rocket simulators."""

    site: SiteConfig | None = nested(default=None, help=SITE_HELP)
    start_s: float | None = start_setting()


@frozen
class WebcastConfig:
    """The settings of telemetry of webcasts."""

    site: SiteConfig | None = nested(default=None, help=SITE_HELP)
    start_s: float | None = start_setting()


@frozen
class TrackConfig:
    """The settings of files with several objects."""

    object: str | None = text(default=None, help="name of the object, where the file has several")


_has_root = deferred("opir_readers.xml_nodes.has_root")


def _rocket(name: str, program: str, **described: Any) -> FileReader:
    """Return the reader of the exports of a rocket simulator."""

    def build(config: RocketConfig, context: ReaderContext) -> StateTable:
        from opir_readers.flights.rocket_exports import rocket_table

        return rocket_table(context.text, program, config.site, config.start_s or 0.0)

    recognises = deferred(f"opir_readers.flights.rocket_exports.is_{name}")
    return FileReader(
        name=name, config=RocketConfig, build=build, recognises=recognises, **described
    )


def _of_object(module: str, function: str) -> Any:
    """Return what builds the table of one object of a file."""
    return reads(module, function, "epoch_us", "object")


def _webcast(config: WebcastConfig, context: ReaderContext) -> StateTable:
    from opir_readers.flights.site import Site
    from opir_readers.flights.webcast import webcast_table

    site = Site.of(config.site, "speed and altitude alone have no place", with_azimuth=True)
    return webcast_table(context.text, site, config.start_s or 0.0)


FLIGHTS = (
    _rocket(
        "openrocket",
        "OpenRocket",
        summary="CSV of OpenRocket, with its events: latitude and longitude, or the position from"
        " the launch point",
        example="""# Time (s),Altitude (m),Vertical velocity (m/s),Latitude (°),Longitude (°)
# Event IGNITION occurred at t=0 seconds
0,0,0,34.73,-120.57
10,900,180,34.7301,-120.5702
# Event BURNOUT occurred at t=12 seconds
20,2500,140,34.7302,-120.5704
""",
    ),
    _rocket(
        "rocketpy",
        "RocketPy",
        summary="CSV of RocketPy (export_data): X, Y and Z from the launch point, or latitude and"
        " longitude",
        example="# Time (s), Latitude (°), Longitude (°), Z (m)\n"
        + "".join(f"{time},34.73,-120.57,{100 + 10 * time * time}\n" for time in range(9)),
    ),
    _rocket(
        "rasaero",
        "RASAero",
        summary="CSV of RASAero II: altitude and distance from a launch point along an azimuth",
        example="Time (sec),Stage,Thrust (lb),Vel-V (ft/sec),Altitude (ft),Distance (ft)\n"
        "0,S,500,0,0,0\n1,S,500,9,9,0\n",
    ),
    FileReader(
        name="webcast",
        summary="JSON or CSV of speed and altitude over time, from a launch point along an azimuth",
        config=WebcastConfig,
        build=_webcast,
        recognises=deferred("opir_readers.flights.webcast.is_webcast"),
        example="".join(
            f'{{"time": {time}, "velocity": {20 * time}, "altitude": {time * time / 100}}}\n'
            for time in range(30)
        ),
    ),
    FileReader(
        name="gpx",
        summary="GPX: a track with times",
        config=TrackConfig,
        build=_of_object("flights.gps_tracks", "gpx_table"),
        recognises=lambda text: _has_root(text, "gpx"),
        example="""<?xml version="1.0"?>
<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><name>ONE</name><trkseg>
<trkpt lat="34.73" lon="-120.57"><ele>100</ele><time>2026-04-01T12:00:00Z</time></trkpt>
<trkpt lat="34.731" lon="-120.571"><ele>900</ele><time>2026-04-01T12:00:10Z</time></trkpt>
</trkseg></trk></gpx>
""",
    ),
    FileReader(
        name="kml",
        summary="KML: a gx:Track, whose places have times",
        config=TrackConfig,
        build=_of_object("flights.gps_tracks", "kml_table"),
        recognises=lambda text: _has_root(text, "kml"),
        example="""<?xml version="1.0"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Placemark><name>ONE</name>
<gx:Track><altitudeMode>absolute</altitudeMode>
<when>2026-04-01T12:00:00Z</when><when>2026-04-01T12:00:10Z</when>
<gx:coord>-120.57 34.73 100</gx:coord><gx:coord>-120.571 34.731 900</gx:coord>
</gx:Track></Placemark></kml>
""",
    ),
    FileReader(
        name="oem-xml",
        summary="CCSDS Orbit Ephemeris Message, XML form",
        config=TrackConfig,
        build=_of_object("oem_table", "oem_xml_table"),
        recognises=deferred("opir_readers.oem_table.is_oem_xml"),
        example="""<?xml version="1.0"?>
<oem id="CCSDS_OEM_VERS" version="2.0"><body><segment><metadata>
<OBJECT_NAME>ONE</OBJECT_NAME><OBJECT_ID>2026-001A</OBJECT_ID><CENTER_NAME>EARTH</CENTER_NAME>
<REF_FRAME>ITRF</REF_FRAME><TIME_SYSTEM>UTC</TIME_SYSTEM>
<START_TIME>2026-04-01T12:00:00</START_TIME><STOP_TIME>2026-04-01T12:00:10</STOP_TIME>
</metadata><data>
<stateVector><EPOCH>2026-04-01T12:00:00</EPOCH><X units="km">-2643.878</X><Y>-4579.332</Y><Z>3566.637</Z>
<X_DOT>-0.053</X_DOT><Y_DOT>-0.091</Y_DOT><Z_DOT>0.083</Z_DOT></stateVector>
<stateVector><EPOCH>2026-04-01T12:00:10</EPOCH><X>-2644.469</X><Y>-4580.355</Y><Z>3567.568</Z>
<X_DOT>-0.065</X_DOT><Y_DOT>-0.114</Y_DOT><Z_DOT>0.104</Z_DOT></stateVector>
</data></segment></body></oem>
""",
    ),
    FileReader(
        name="sp3",
        summary="SP3 orbit of a satellite, Earth-fixed",
        config=TrackConfig,
        build=_of_object("sp3_table", "sp3_table"),
        recognises=deferred("opir_readers.sp3_table.is_sp3"),
        example="""#cP2026  4  1 12  0  0.00000000       2 ORBIT IGS20 HLM  IGS
## 2412 302400.00000000   900.00000000 61131 0.5000000000000
+    1   G01
%c G  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
*  2026  4  1 12  0  0.00000000
PG01  15600.500000 -14000.250000  16200.100000    120.500000
*  2026  4  1 12 15  0.00000000
PG01  16800.500000 -11900.250000  16900.100000    121.500000
EOF
""",
    ),
)
