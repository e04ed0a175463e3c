"""Emitters from random fields and from CSV files, and what is wrong with a CSV."""

from pathlib import Path

import numpy as np
import pytest
from infrared_sources import context, field, region
from opir_photons.radiometry.source_configs import BolideConfig, FireConfig, FlareConfig
from opir_photons.radiometry.sources import bolide_sources, fire_sources, flare_sources
from scipy import stats

from opir_core.errors import ModelError, SceneError
from opir_core.geometry import ecef_to_geodetic


class TestField:
    def test_places_are_uniform_over_the_region(self):
        sources = fire_sources(FireConfig(field=field(60.0)), context())
        where = ecef_to_geodetic(sources.trajectories.start_ecef_m)
        sines = np.sin(where.latitude_rad)
        longitudes = np.degrees(where.longitude_rad)
        low, high = np.sin(np.radians([-10.0, 20.0]))
        assert stats.kstest(sines, stats.uniform(low, high - low).cdf).pvalue > 1e-3
        assert stats.kstest(longitudes, stats.uniform(30.0, 30.0).cdf).pvalue > 1e-3

    @pytest.mark.slow
    def test_counts_are_poissons_with_the_stated_density(self):
        mean = (
            0.5
            * 6.371007181**2
            * np.radians(30.0)
            * (np.sin(np.radians(20.0)) + np.sin(np.radians(10.0)))
        )
        counts = [
            len(fire_sources(FireConfig(field=field(0.5)), context(seed)).ids)
            for seed in range(400)
        ]
        # 99.9 % of the mean of 400 counts, and of their variance over their mean.
        assert np.mean(counts) == pytest.approx(mean, abs=3.29 * np.sqrt(mean / 400))
        low, high = stats.chi2.ppf([0.0005, 0.9995], 399) / 399
        assert low < np.var(counts, ddof=1) / np.mean(counts) < high

    def test_areas_spread_as_stated(self):
        sources = flare_sources(FlareConfig(field=field(60.0, sigma=0.7)), context())
        logs = np.log([row["area_m2"] / 30.0 for row in sources.trajectories.truth()])
        assert stats.kstest(logs, stats.norm(0.0, 0.7).cdf).pvalue > 1e-3

    def test_brief_emitters_begin_at_an_hourly_rate(self):
        sources = bolide_sources(BolideConfig(field=field(400.0)), context(duration_s=360.0))
        starts = sources.trajectories.ignition_s
        assert len(starts) == pytest.approx(0.1 * 400.0 * 11.04, abs=3.29 * np.sqrt(442.0))
        assert stats.kstest(starts, stats.uniform(0.0, 360.0).cdf).pvalue > 1e-3

    def test_a_region_may_cross_the_date_line(self):
        sources = fire_sources(
            FireConfig(field=field(20.0, region(-5.0, 5.0, 170.0, -170.0))), context()
        )
        longitudes = np.array([row["lon_deg"] for row in sources.trajectories.truth()])
        assert len(longitudes) > 20
        assert (np.abs(longitudes) >= 170.0).all()
        assert (longitudes > 0.0).any()
        assert (longitudes < 0.0).any()

    def test_a_field_depends_on_seed_and_id(self):
        places = [
            fire_sources(FireConfig(field=field(1.0)), context(seed)).trajectories.start_ecef_m
            for seed in (1, 1, 2)
        ]
        assert places[0].tolist() == places[1].tolist()
        assert places[0].tolist() != places[2].tolist()

    def test_an_empty_field_is_empty(self):
        assert fire_sources(FireConfig(field=field(0.0)), context()).ids == ()

    def test_too_many_are_refused(self):
        with pytest.raises(
            ModelError, match=r"sources\[0\]: .* emitters are expected; a block has at most 20000"
        ):
            fire_sources(FireConfig(field=field(1e6)), context())


class TestCsv:
    def read(self, tmp_path: Path, text: str, **settings):
        path = tmp_path / "fires.csv"
        path.write_text(text, encoding="utf-8")
        return fire_sources(FireConfig(csv=str(path), **settings), context())

    def test_columns_in_any_order_with_blanks_for_the_blocks_values(self, tmp_path):
        text = "# made up\narea_m2, lat_deg ,lon_deg\n10,1.5,-2\n\n,3,4e0\n"
        reported = self.read(tmp_path, text, area_m2=7.0).trajectories.truth()
        assert [(row["lat_deg"], row["lon_deg"], row["area_m2"]) for row in reported] == [
            (1.5, -2.0, 10.0),
            (3.0, 4.0, 7.0),
        ]

    def test_what_spreadsheets_write_is_read(self, tmp_path):
        """A mark of byte order before the header, and a comma after each line's last cell."""
        reported = self.read(tmp_path, "\ufefflat_deg,lon_deg,\n1,2,\n").trajectories.truth()
        assert [(row["lat_deg"], row["lon_deg"]) for row in reported] == [(1.0, 2.0)]

    @pytest.mark.parametrize(
        "content",
        [
            b"lat_deg;lon_deg\n1,5;-2,25\n",
            "lat_deg;lon_deg\r\n1,5;-2,25\r\n".encode("utf-8-sig"),
            "lat_deg\tlon_deg\n1,5\t-2,25\n".encode("utf-16"),
            b"lat_deg,lon_deg\r1.5,-2.25\r",
        ],
    )
    def test_other_delimiters_decimals_and_ends_of_lines_are_read(self, tmp_path, content):
        path = tmp_path / "fires.csv"
        path.write_bytes(content)
        (reported,) = fire_sources(FireConfig(csv=str(path)), context()).trajectories.truth()
        assert (reported["lat_deg"], reported["lon_deg"]) == (1.5, -2.25)

    @pytest.mark.parametrize(
        ("text", "complaint"),
        [
            ("", "line 1: a header with lat_deg and lon_deg is needed"),
            ("lat_deg,lon_deg\n1,2\n\n3,x\n", "line 4: lon_deg: 'x' is not a number"),
            ("lat_deg,lon_deg\n1,2,3\n", "line 2: 3 cells under a header of 2"),
            ("lat_deg,lon_deg\n91,2\n", "line 2: lat_deg: 91.0 is outside [-90, 90] deg"),
            ("lat_deg,lon_deg\n1,\n", "line 2: lon_deg is missing"),
            (
                "lat_deg,lon_deg,area_m2\n1,2,nan\n",
                "line 2: area_m2: nan is outside [1e-06, 1000000000000] m2",
            ),
            (
                "lat_deg,lon_deg,colour\n1,2,3\n",
                (
                    "line 1: in the header colour is not one of lat_deg, lon_deg, height_m, start_s,"
                    " end_s, temperature_k,"
                ),
            ),
            ("lat_deg,lat_deg\n1,2\n", "line 1: a name stands twice in the header"),
            ("lat_deg,lon\n", "line 1: in the header lon: unknown; did you mean lon_deg?"),
            ("lat_deg,area_m2\n1,2\n", "line 1: in the header lon_deg is missing"),
            (
                "lat_deg lon_deg\n1 2\n",
                "line 1: the header is one cell; commas, semicolons or tabs separate",
            ),
            ("lat_deg;lon_deg\n1,5;2,x\n", "line 2: lon_deg: '2.x' is not a number"),
            ("lat_deg,lon_deg,area_m2\n1,2,1_000\n", "line 2: area_m2: '1_000' is not a number"),
            (
                "lat_deg,lon_deg,start_s,end_s\n1,2,50,10\n",
                "line 2: end_s 10 is not after start_s 50",
            ),
            ("lat_deg,lon_deg,\n1,2,3\n", "line 2: '' is not one of lat_deg, lon_deg"),
        ],
    )
    def test_what_is_wrong_is_reported_with_file_and_line(self, tmp_path, text, complaint):
        with pytest.raises(SceneError) as caught:
            self.read(tmp_path, text)
        (problem,) = caught.value.problems
        assert problem.path == "sources[0].csv"
        assert f"fires.csv, {complaint}" in problem.message
        assert "\n" not in problem.message

    def test_files_that_are_not_there_or_not_text(self, tmp_path):
        with pytest.raises(
            SceneError, match=r"sources\[0\].csv: .*none.csv cannot be read: no such file"
        ):
            fire_sources(FireConfig(csv=str(tmp_path / "none.csv")), context())
        path = tmp_path / "bytes.csv"
        path.write_bytes(b"lat_deg,lon_deg\n\xff\xfe,1\n")
        with pytest.raises(SceneError, match=r"bytes.csv, line 2: is not UTF-8 text"):
            fire_sources(FireConfig(csv=str(path)), context())
