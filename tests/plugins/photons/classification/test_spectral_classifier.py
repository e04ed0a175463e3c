"""The classifier `spectral`: densities and Bayes' rule against closed forms, extremes, thresholds,
tracks.
"""

import json
import math
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st
from numpy.typing import NDArray
from opir_photons.classification.configs import PosteriorConfig, SpectralConfig
from opir_photons.classification.gaussian_mixture import Components, Mixture
from opir_photons.classification.hot_sources import KINDS
from opir_photons.classification.posterior_confidence import (
    PosteriorConfidence,
    posterior_confidence,
)
from opir_photons.classification.priors import GROUP_SHARES, launch_shares
from opir_photons.classification.spectral import SpectralClassifier
from opir_photons.classification.synthetic_looks import low_discrepancy_points
from opir_photons.classification.type_densities import EventRates, TypeDensities, elevation_bin
from opir_photons.classification.unknown_objects import LEAST_W_SR, MOST_W_SR, log_uniform_in_noise
from opir_testing import stub_window
from opir_testing.bench import bench_scene, encoder_of
from scipy.special import logsumexp
from scipy.stats import binom, multivariate_normal, norm

import opir_core as opir
from opir_core import Tracks, compile_plan
from opir_core.builtin.classification import ConstantConfidence
from opir_core.errors import ModelError
from opir_core.output import detection_schema
from opir_core.plugin import REPORTED_TYPES, ClassifierInputs, ModelContext
from opir_core.reading import scene_mapping
from opir_core.scene import UNKNOWN_TYPE, core_hypotheses, core_target_class, hypotheses_of
from opir_core.simulation.measurement import with_tracks

#: Apparent intensities are irradiances times the square of this, m.
RANGE_M = 1e3
PLACES = 4


def one(log_weight: float, mean: list[float], sigma: list[float]) -> Components:
    """Return one component with independent numbers."""
    return Components(np.array([log_weight]), np.array([mean]), np.diag(np.square(sigma))[None])


#: Hypotheses of three missile types and a launch into space; their numbers, and those of the
#: others.
HYPOTHESES = hypotheses_of(core_target_class(name) for name in ("SRBM", "IRBM", "ICBM", "SLV"))
NAMES = [each.name for each in HYPOTHESES]
NOISE, GROUND, BOLIDE, SRBM, IRBM, ICBM, SLV, NONE = range(len(HYPOTHESES))

#: Reported events, 1/s: of flights (SRBM, IRBM, ICBM, SLV), and of a source detected 200 times on
#: average.
FLIGHT_RATES = np.array([0.2, 0.3, 0.4, 0.1])
OTHER_RATE = 0.1
MEAN_COUNT = 200.0
#: Rates too low to matter.
NEVER = -1e9


def rates(*, noise: float = NEVER, unknown: float = NEVER) -> EventRates:
    """Return rates of flights, of the one kind of sources, of noise, and of what is none of
    these.
    """
    log_rates = np.full((len(HYPOTHESES), 7), -np.inf)
    log_rates[[SRBM, IRBM, ICBM, SLV], range(4)] = np.log(FLIGHT_RATES)
    log_rates[[GROUND, NOISE, NONE], [4, 5, 6]] = np.log(OTHER_RATE), noise, unknown
    return EventRates(log_rates, 2, -12.0, 8640.0)


def known_bank(**changes: Any) -> TypeDensities:
    """Return a bank of one component a flight, seen equally long, and one of anything else, in one
    band and a count.
    """
    flights = [[one(0.0, [mean, 50.0], [3.0, 40.0])] for mean in (30.0, 60.0, 100.0, 140.0)]
    plumes = Mixture.of([[part for (part,) in flights]] * PLACES)
    others = Mixture.of(
        [[one(0.0, [45.0, MEAN_COUNT], [30.0, 1.0]), one(0.0, [0.0, 0.0], [0.0, 0.0])]] * PLACES
    )
    return evolve(
        TypeDensities(1, plumes, np.zeros((PLACES, 4)), others, 1000.0, rates(), kinds=KINDS[:1]),
        **changes,
    )


def known_classifier(**changes: Any) -> SpectralClassifier:
    known = SpectralClassifier(
        make_banks=lambda: (known_bank(),),
        bank_of_sensor=np.zeros(1, dtype=np.int64),
        hypotheses=HYPOTHESES,
        reported_types=REPORTED_TYPES,
        log_prior=np.log(FLIGHT_RATES[[2, 1, 0]]),
        confidence=0.6,
        least_log_odds=-np.inf,
        launches_per_day=86_400.0,
    )
    return evolve(known, **changes)


def posterior(**chances: float) -> NDArray[np.float64]:
    """Return ln P (1, hypotheses) of the hypotheses that are named, the others being impossible."""
    with np.errstate(divide="ignore"):
        return np.log([[chances.get(name, 0.0) for name in NAMES]])


def sightings(intensity: Any, noise: Any, count: Any = 50) -> ClassifierInputs:
    """Return sightings of apparent intensities and noise (n,) or (n, B), W/sr."""
    signal = np.atleast_2d(np.asarray(intensity, dtype=np.float64).T).T
    rows = len(signal)
    zeros = np.zeros(len(signal))
    total = np.zeros(rows, dtype=np.int32)
    return ClassifierInputs(
        time_s=zeros,
        sensor=total,
        target=total - 1,
        range_m=zeros + RANGE_M,
        elevation_sine=zeros + 0.5,
        bands=total.astype(np.uint8),
        band_count=total.astype(np.int64),
        band_total=total.astype(np.int64) + 1,
        detection_count=np.broadcast_to(np.asarray(count, dtype=np.int32), (rows,)),
        snr=zeros,
        band_irradiance_w_m2=signal / RANGE_M**2,
        band_noise_w_m2=np.broadcast_to(
            np.atleast_2d(np.asarray(noise, dtype=np.float64).T).T, signal.shape
        )
        / RANGE_M**2,
    )


def test_posteriors_follow_bayes_rule() -> None:
    measured = np.array([96.0, 57.0, 31.0, 80.0])
    noise = 4.0
    count = 70
    log = known_classifier().log_posterior(sightings(measured, noise, count))
    # Counts begin at 1: the density below 0.5 is reflected.
    counted = norm.pdf(count, 50.0, 40.0) + norm.pdf(1 - count, 50.0, 40.0)
    like = norm.pdf(measured[:, None], [30.0, 60.0, 100.0, 140.0], np.hypot(3.0, noise)) * counted
    launched = FLIGHT_RATES * like
    other = (
        OTHER_RATE
        * norm.pdf(measured, 45.0, np.hypot(30.0, noise))
        * np.exp(-count / MEAN_COUNT)
        / MEAN_COUNT
    )
    every = np.column_stack([other, launched])
    of_these = [GROUND, SRBM, IRBM, ICBM, SLV]
    assert np.allclose(
        np.exp(log[:, of_these]), every / every.sum(axis=1, keepdims=True), rtol=1e-12
    )
    types = known_classifier().over_types(log, REPORTED_TYPES)
    odds = launched[:, :3].sum(axis=1) / (launched[:, 3] + other)
    assert np.allclose(known_classifier().log_odds(types), np.log(odds), rtol=1e-10)


def test_noise_has_the_detections_that_confirm() -> None:
    # Events of which noise alone is as bright, 1e4 times as often as launches.
    bank = known_bank(rates=rates(noise=float(np.log(1e4))))
    log = known_classifier(make_banks=lambda: (bank,)).log_posterior(
        sightings([12.0] * 3, 4.0, [2, 3, 5])
    )
    odds = np.diff(log[:, NOISE] - log[:, SRBM])
    # Each further detection makes noise e^12 times less likely; counts of launches hardly change.
    assert odds == pytest.approx([-12.0, -24.0], abs=0.2)


def test_a_count_tells_types_apart_that_bands_do_not() -> None:
    flights = [[one(0.0, [50.0, mean], [3.0, 20.0])] for mean in (60.0, 150.0, 300.0, 600.0)]
    bank = known_bank(plumes=Mixture.of([[part for (part,) in flights]] * PLACES))
    log = known_classifier(make_banks=lambda: (bank,)).log_posterior(
        sightings([50.0] * 4, 1.0, [60, 150, 300, 600])
    )
    assert [NAMES[row] for row in np.argmax(log, axis=1)] == ["SRBM", "IRBM", "ICBM", "SLV"]


def test_unknown_intensities_raise_none_of_these() -> None:
    bank = known_bank(rates=rates(unknown=float(np.log(1e-3))))
    seen = sightings([30.0, 60.0, 100.0, 140.0, 500.0, 5e4], 4.0)
    chance = np.exp(known_classifier(make_banks=lambda: (bank,)).log_posterior(seen))[:, NONE]
    assert np.all(chance[:4] < 0.01)
    assert np.all(chance[4:] > 0.99)


@pytest.mark.parametrize("sigma", [1e-3, 3.0, 1e4, 1e7])
def test_the_density_of_none_is_a_log_uniform_intensity_in_noise(sigma: float) -> None:
    log_s = np.linspace(np.log(LEAST_W_SR), np.log(MOST_W_SR), 400_001)
    measured = np.array([-2.0, 0.5, 3.0, 7.0, 20.0]) * sigma + np.array([0.0, 0.0, 0.0, 0.0, 30.0])
    # Where neither limit is near: below and above it the density goes on, while intensities end
    # there.
    for y in measured[((measured > 10.0) | (sigma > 100.0)) & (measured < 1e8)]:
        exact = np.trapezoid(norm.pdf(y, np.exp(log_s), sigma), log_s) / (log_s[-1] - log_s[0])
        result = np.exp(log_uniform_in_noise(np.array([y]), np.array([sigma**2])))[0]
        assert result == pytest.approx(exact, rel=0.03)


def test_missiles_are_summed_by_reported_type() -> None:
    hypotheses = core_hypotheses()
    chance = np.arange(1.0, 1.0 + len(hypotheses))
    log = np.log(chance / chance.sum())[None]
    by_name = dict(zip([each.name for each in hypotheses], chance / chance.sum(), strict=True))
    paper = np.exp(known_classifier(hypotheses=hypotheses).over_types(log, REPORTED_TYPES))[0]
    assert paper[0] == pytest.approx(by_name["ICBM"] + by_name["SLBM"])
    assert paper[1] == pytest.approx(by_name["IRBM"] + by_name["MRBM"] + by_name["HGV"])
    assert paper[2] == pytest.approx(by_name["SRBM"])
    assert paper[3] == pytest.approx(
        by_name["SLV"]
        + sum(by_name[name] for name in ("noise", "ground source", "bolide", "none of these"))
    )
    types = (*REPORTED_TYPES, "HGV", "MRBM", "SLBM", "SLV")
    classes = np.exp(known_classifier(hypotheses=hypotheses).over_types(log, types))[0]
    assert classes[[0, 4, 7]] == pytest.approx([by_name[name] for name in ("ICBM", "HGV", "SLV")])


def test_classes_are_reported_where_the_scene_reports_classes() -> None:
    log = posterior(SLV=0.9, ICBM=0.1)
    classes = (*REPORTED_TYPES, "SLV")
    assert known_classifier().reported(log).tolist() == [UNKNOWN_TYPE]
    finer = known_classifier(reported_types=classes)
    assert [classes[code] for code in finer.reported(log)] == ["SLV"]
    assert PosteriorConfidence(finer, classes).of_types(finer.reported(log), log) == pytest.approx(
        [0.9]
    )


@pytest.mark.parametrize("bands", [1, 2, 3, 8])
def test_densities_of_mixtures_are_those_of_scipy(bands: int) -> None:
    rng = np.random.default_rng([3, bands])
    parts = []
    rows = 5
    for _ in range(3):
        root = rng.standard_normal((4, bands + 1, bands + 1))
        parts.append(
            Components(
                rng.standard_normal(4), rng.standard_normal((4, bands + 1)) * 3.0, root @ root.mT
            )
        )
    mixture = Mixture.of([parts])
    signal = rng.standard_normal((rows, bands))
    variance = rng.random((rows, bands))
    count = rng.standard_normal(rows)
    seen, counted = mixture.log_densities(np.zeros(rows, dtype=np.int64), signal, variance, count)
    every = [
        (w, m, c) for p in parts for w, m, c in zip(p.log_weight, p.mean, p.covariance, strict=True)
    ]
    for row in range(rows):
        for column, (weight, mean, covariance) in enumerate(every):
            total = covariance + np.diag([*variance[row], 0.0])
            alone = multivariate_normal(mean[:-1], total[:-1, :-1]).logpdf(signal[row])
            both = multivariate_normal(mean, total).logpdf([*signal[row], count[row]])
            assert seen[row, column] == pytest.approx(weight + alone, rel=1e-8, abs=1e-8)
            assert counted[row, column] == pytest.approx(both - alone, rel=1e-7, abs=1e-7)
    sums = [logsumexp(seen[:, 4 * code : 4 * code + 4], axis=1) for code in range(3)]
    assert np.allclose(mixture.by_class(seen), np.stack(sums, axis=1), rtol=1e-12)


@pytest.mark.parametrize("bands", [1, 2, 3])
def test_densities_of_classes_reflect_counts_and_have_a_floor(bands: int) -> None:
    rng = np.random.default_rng([5, bands])
    least, floor, rows = 0.5, 1e-3, 400
    classes = []
    for size in (3, 1):
        root = rng.standard_normal((size, bands + 1, bands + 1))
        mean = rng.standard_normal((size, bands + 1)) * 3.0
        mean[:, -1] = 2.0
        classes.append(Components(rng.standard_normal(size), mean, root @ root.mT))
    mixture = Mixture.of([classes, classes[::-1]])
    place = rng.integers(0, 2, rows)
    signal = rng.standard_normal((rows, bands)) * 10.0
    variance = rng.random((rows, bands))
    count = rng.uniform(least, 30.0, rows)
    log = mixture.log_class_densities(place, signal, variance, count, least, floor)
    for row in range(0, rows, 20):
        for code, parts in enumerate(classes[:: 1 - 2 * int(place[row])]):
            terms = []
            for weight, mean, spread in zip(
                parts.log_weight, parts.mean, parts.covariance, strict=True
            ):
                total = spread + np.diag([*variance[row], 0.0])
                of_signal = multivariate_normal(mean[:-1], total[:-1, :-1]).logpdf(signal[row])
                joint = multivariate_normal(mean, total)
                both = [
                    joint.logpdf([*signal[row], n]) for n in (count[row], 2 * least - count[row])
                ]
                terms.append(weight + max(logsumexp(both), of_signal + np.log(floor)))
            assert log[row, code] == pytest.approx(logsumexp(terms), rel=1e-8, abs=1e-8)
    # A row's densities do not depend on the rows beside it.
    alone = mixture.log_class_densities(
        place[7:8], signal[7:8], variance[7:8], count[7:8], least, floor
    )
    assert alone.tobytes() == log[7:8].tobytes()


def test_padding_of_mixtures_changes_nothing() -> None:
    few = [one(0.0, [1.0, 2.0], [1.0, 1.0])]
    more = Components(np.zeros(3), np.ones((3, 2)), np.tile(np.eye(2), (3, 1, 1)))
    both = Mixture.of([few, [more]])
    arguments = np.array([[0.3]]), np.array([[0.2]]), np.array([1.0])
    alone = Mixture.of([few]).log_densities(np.zeros(1, np.int64), *arguments)[0]
    padded = both.log_densities(np.zeros(1, np.int64), *arguments)[0]
    assert both.by_class(padded)[0, 0] == Mixture.of([few]).by_class(alone)[0, 0] == alone[0, 0]


def test_ratios_are_exact_where_probabilities_are_no_doubles() -> None:
    # Noise of 1, a thousand deviations off every density: e^-500000 and less.
    log = known_classifier().log_posterior(sightings([3000.0, -3000.0], 1e-6))
    assert np.isfinite(log[:, [GROUND, SRBM, IRBM, ICBM, SLV]]).all()
    for row, y in enumerate((3000.0, -3000.0)):
        count = np.logaddexp(norm.logpdf(50.0, 50.0, 40.0), norm.logpdf(-49.0, 50.0, 40.0))
        launched = (
            logsumexp(norm.logpdf(y, [30.0, 60.0, 100.0, 140.0], 3.0), b=FLIGHT_RATES) + count
        )
        expected = (
            launched
            - norm.logpdf(y, 45.0, 30.0)
            - np.log(OTHER_RATE / MEAN_COUNT)
            + 50.0 / MEAN_COUNT
        )
        assert expected < -1e5
        result = logsumexp(log[row, SRBM : SLV + 1]) - log[row, GROUND]
        assert result == pytest.approx(expected, rel=1e-9)


@given(
    st.lists(st.floats(-1e12, 1e12), min_size=1, max_size=8),
    st.sampled_from([0.0, 1e-12, 1e-6, 1.0, 1e6, 1e12]),
    st.integers(1, 2**31 - 1),
)
def test_posteriors_are_probabilities_whatever_is_measured(
    snr: list[float], noise: float, count: int
) -> None:
    seen = sightings(np.array(snr) * (noise or 1.0), noise, count)
    classifier = known_classifier()
    log = classifier.log_posterior(seen)
    assert not np.isnan(log).any()
    assert np.all(log <= 1e-12)
    assert np.allclose(np.exp(log).sum(axis=1), 1.0, rtol=1e-12)
    order = np.arange(len(snr))[::-1]
    assert np.array_equal(classifier.log_posterior(seen.take(order)), log[order])


def test_an_unlikely_type_is_unknown() -> None:
    classifier = known_classifier(confidence=0.9)
    chances = [(0.89, 0.05, 0.05, 0.01), (0.91, 0.04, 0.04, 0.01), (0.02, 0.02, 0.02, 0.94)]
    names = ("ICBM", "IRBM", "SRBM", "none of these")
    log = np.concatenate([posterior(**dict(zip(names, row, strict=True))) for row in chances])
    assert [REPORTED_TYPES[code] for code in classifier.reported(log)] == [
        "UNKNOWN",
        "ICBM",
        "UNKNOWN",
    ]


def test_odds_below_the_threshold_are_unknown() -> None:
    log = posterior(ICBM=0.9, IRBM=0.05, SRBM=0.04, SLV=0.01)
    odds = float(known_classifier().log_odds(known_classifier().over_types(log, REPORTED_TYPES))[0])
    assert odds == pytest.approx(np.log(0.99 / 0.01))
    codes = [known_classifier(least_log_odds=odds + off).reported(log)[0] for off in (-1e-9, 1e-9)]
    assert codes == [0, UNKNOWN_TYPE]


def test_the_motion_of_a_track_takes_the_place_of_the_prior() -> None:
    classifier = known_classifier()
    log = classifier.log_posterior(sightings([45.0, 45.0, 45.0], 20.0))
    of_track = np.array([[0.0, 0.25, 0.75, 0.0], [np.nan] * 4, [0.0, 0.0, 0.0, 1.0]])
    revised = classifier.revised(log, of_track)
    missiles = [ICBM, IRBM, SRBM]
    like = np.exp(log[0, missiles]) / np.array([0.4, 0.3, 0.2]) * of_track[0, :3]
    assert np.allclose(
        np.exp(revised[0, missiles]), like / like.sum() * np.exp(log[0, missiles]).sum()
    )
    # Whether it is a missile is for its light to say, and a track that knows nothing says nothing.
    remainder = [NOISE, GROUND, BOLIDE, SLV, NONE]
    assert np.array_equal(revised[0, remainder], log[0, remainder])
    assert np.array_equal(revised[1:], log[1:])


def tracks(*, knows_burnout: bool) -> Tracks:
    nothing = Tracks.empty()
    return Tracks(
        tick_s=np.zeros(1),
        track=np.ones(1, dtype=np.int64),
        **{
            name: np.zeros((1, *getattr(nothing, name).shape[1:]))
            for name in (
                "state",
                "state_covariance",
                "launch",
                "launch_covariance",
                "impact",
                "impact_covariance",
            )
        },
        type_probability=np.array([[0.0, 0.0, 1.0, 0.0]]),
        burnout=np.zeros((1, 7)) if knows_burnout else np.full((1, 7), np.nan),
    )


def test_confidence_is_the_probability_of_what_is_reported() -> None:
    seen = sightings([96.0, 57.0, 31.0, 500.0], 4.0, 70)
    classifier = known_classifier()
    log = classifier.log_posterior(seen)
    reported = classifier.reported(log)
    assert {0, UNKNOWN_TYPE} <= set(reported.tolist())
    expected = np.exp(classifier.over_types(log, REPORTED_TYPES))[np.arange(4), reported]
    assert np.array_equal(
        PosteriorConfidence(classifier).confidence(seen), np.minimum(expected, 1.0)
    )


#: A detection of a track and one of none, alike.
ALIKE = np.repeat(posterior(ICBM=0.8, IRBM=0.1, SRBM=0.05, SLV=0.05), 2, axis=0)


def judged(**changes: Any) -> Any:
    """Return two detections with the posteriors `ALIKE`, the first of a track."""
    detections = stub_window(
        2, estimate=np.array([0, -1]), reported_type=np.zeros(2, np.uint8)
    ).detections
    types = known_classifier().over_types(ALIKE, REPORTED_TYPES)
    return evolve(
        detections, type_log_probability=types, hypothesis_log_probability=ALIKE, **changes
    )


def test_confidence_follows_when_motion_revises_types() -> None:
    model = PosteriorConfidence(known_classifier())
    plain = judged(confidence=np.array([0.8, 0.8]))
    result = with_tracks(known_classifier(), model, plain, tracks(knows_burnout=True))
    rows = np.arange(2), result.reported_type
    assert result.confidence == pytest.approx(np.exp(result.type_log_probability)[rows])
    assert result.confidence[1] == 0.8 != result.confidence[0]


@pytest.mark.parametrize("knows_burnout", [True, False])
def test_types_from_motion_need_a_burnout(knows_burnout: bool) -> None:
    classifier = known_classifier()
    model = ConstantConfidence(0.5)
    result = with_tracks(classifier, model, judged(), tracks(knows_burnout=knows_burnout))
    assert result.reported_type.tolist() == ([2, 0] if knows_burnout else [0, 0])
    assert np.array_equal(result.hypothesis_log_probability[1], ALIKE[1])
    assert np.array_equal(
        classifier.over_types(result.hypothesis_log_probability, REPORTED_TYPES),
        result.type_log_probability,
    )
    assert np.allclose(result.type_probability.sum(axis=1), 1.0)


def test_points_fill_the_cube_evenly() -> None:
    points = low_discrepancy_points(2000, 5)
    assert np.all((points > 0.0) & (points < 1.0))
    shares: NDArray[np.float64] = (
        np.array([np.histogram(column, 10, (0.0, 1.0))[0] for column in points.T]) / 2000
    )
    assert np.all(np.abs(shares - 0.1) < 0.005)


def test_parts_of_the_sky_hold_every_elevation() -> None:
    assert elevation_bin(np.array([-1.0, 0.0, 0.2, 0.5, 1.0])).tolist() == [0, 0, 1, 2, 3]


def test_a_prior_is_checked_when_it_is_read() -> None:
    with pytest.raises(ValueError, match=r"the shares sum to 1\.1"):
        SpectralConfig(prior={"ICBM": 0.6, "IRBM": 0.2, "SRBM": 0.3})


def test_priors_of_unknown_classes_are_refused() -> None:
    scene = bench_scene(
        detection="snr", classification={"model": "spectral", "prior": {"ICBM": 0.5, "MRBN": 0.5}}
    )
    with pytest.raises(
        ModelError,
        match=r"prior: 'MRBN' is no target class; the nearest is 'MRBM'; these are .*SLV",
    ):
        compile_plan(opir.scene_from_mapping(scene))


def test_shares_of_launches_are_equal_over_the_missile_types() -> None:
    hypotheses = core_hypotheses()
    share = dict(
        zip([each.name for each in hypotheses], launch_shares({}, hypotheses), strict=True)
    )
    assert math.fsum(share.values()) == pytest.approx(1.0)
    third = GROUP_SHARES["missile"] / 3.0
    assert [
        share["ICBM"] + share["SLBM"],
        share["IRBM"] + share["MRBM"],
        share["SRBM"],
    ] == pytest.approx([third] * 3)
    assert [share["SLV"], share["HGV"], share["noise"]] == [
        GROUP_SHARES["orbit"],
        GROUP_SHARES["glide"],
        0.0,
    ]


@pytest.mark.slow
def test_a_class_without_a_share_is_not_expected() -> None:
    prior = {"ICBM": 0.5, "SRBM": 0.5}
    scene = bench_scene(
        detection="snr", classification={"model": "spectral", "prior": prior, "launches": 8}
    )
    run = opir.simulate(opir.scene_from_mapping(scene))
    chance = np.exp(run.detections.hypothesis_log_probability).max(axis=0)
    names = [each.name for each in compile_plan(opir.scene_from_mapping(scene)).hypotheses]
    possible = {name for name, most in zip(names, chance.tolist(), strict=True) if most > 0.0}
    assert {"ICBM", "SRBM", "none of these"} <= possible
    assert not {"IRBM", "MRBM", "SLBM", "HGV", "SLV"} & possible


@pytest.mark.parametrize(
    ("detection", "name"), [("constant", "paper"), ("snr", "spectral"), ("always", "paper")]
)
def test_irradiance_models_bring_their_classifier(detection: str, name: str) -> None:
    mapping = bench_scene(detection=detection)
    del mapping["classification"]
    scene = opir.scene_from_mapping(mapping)
    assert scene.classification.name == name
    plain = opir.scene_from_mapping(
        {**mapping, "detection": "constant"}, overrides=[f"detection={detection}"]
    )
    assert plain.classification.name == name
    assert opir.scene_from_mapping(scene_mapping(scene)) == scene
    assert (
        opir.scene_from_mapping({**mapping, "classification": "none"}).classification.name == "none"
    )


def test_a_setting_of_the_default_classifier_is_overridden() -> None:
    mapping = bench_scene(detection={"model": "snr"})
    del mapping["classification"]
    scene = opir.scene_from_mapping(mapping, overrides=["classification.launches=8"])
    assert (scene.classification.name, scene.classification.config.launches) == ("spectral", 8)


def test_a_prior_tells_how_many_launches_it_expects() -> None:
    assert known_classifier(launches_per_day=720.0).expected_launches(120.0) == pytest.approx(1.0)


def test_a_detection_model_without_light_is_refused_in_words() -> None:
    scene = opir.scene_from_mapping(bench_scene(detection="constant", classification="spectral"))
    with pytest.raises(ModelError, match=r"classification: spectral.*choose detection: snr"):
        compile_plan(scene)


def test_events_carry_type_probabilities() -> None:
    log = np.log([[0.8, 0.1, 0.05, 0.05]])
    plan = compile_plan(opir.scene_from_mapping(bench_scene(targets=[])))
    plain = stub_window(1, sensor=np.zeros(1, np.int32), bands=np.ones(1, np.uint8))
    judged = evolve(plain, detections=evolve(plain.detections, type_log_probability=log))
    before, after = (json.loads(encoder_of(plan).encode(window)) for window in (plain, judged))
    order = [name for name in detection_schema()["properties"] if name in after]
    assert list(after) == order
    assert set(after) - set(before) == {"type_probability"}
    assert after.pop("type_probability") == {
        "ICBM": 0.8,
        "IRBM": 0.1,
        "SRBM": 0.05,
        "UNKNOWN": 0.05,
    }
    assert after == before


@pytest.mark.slow
@pytest.mark.parametrize("nei_w_m2", [0.0, 1e-30, 1e6])
def test_no_noise_and_enormous_noise_are_judged(nei_w_m2: float) -> None:
    sensor = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": -100.0,
        "nei_w_m2": nei_w_m2,
    }
    scene = bench_scene(
        sensors=[{**sensor, "scan_period_ms": 5000.0}],
        detection={"model": "snr", "exact": True},
        classification={"model": "spectral", "launches": 8},
        duration_s=60.0,
    )
    run = opir.simulate(opir.scene_from_mapping(scene))
    chances = run.detections.type_probability
    assert len(chances) > 0 or nei_w_m2 == 1e6
    assert np.allclose(chances.sum(axis=1), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.01])
def test_false_source_probability_holds(share: float) -> None:
    """Sources of the classifier's own prior, through the engine: at most the share, within 99.9 %,
    by kind.
    """
    rng = np.random.default_rng(5)
    rows = [
        {
            "lat_deg": float(latitude),
            "lon_deg": float(longitude),
            "temperature_k": float(rng.uniform(800.0, 1200.0)),
            "area_m2": float(1800.0 * np.exp(1.5 * rng.standard_normal())),
        }
        for latitude, longitude in zip(
            rng.uniform(-60.0, 60.0, 600), rng.uniform(-60.0, 60.0, 600), strict=True
        )
    ]
    sensor = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": 0.0,
        "bands": {"SWIR": [2.5, 3.0], "MWIR": [4.0, 5.0]},
    }
    scene = opir.scene_from_mapping(
        {
            "scene": "fires",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 60.0,
            "sensors": [{**sensor, "scan_period_ms": 10_000.0, "detection_probability": {}}],
            "targets": [],
            "sources": [{"id": "F", "model": "fires", "emissivity": 1.0, "at": rows}],
            "detection": "snr",
            "classification": {
                "model": "spectral",
                "confidence": 0.0,
                "false_source_probability": share,
            },
            "atmosphere": "lowtran",
            "outputs": [],
        }
    )
    run = opir.simulate(scene)
    first = np.unique(run.truth.target, return_index=True)[1]
    taken = np.sum(run.detections.reported_type[first] != UNKNOWN_TYPE)
    assert len(first) > 300
    assert taken <= binom.isf(0.001, len(first), share)


def test_a_sensor_that_sees_hardly_any_ground_is_refused_in_words() -> None:
    scene = opir.scene_from_mapping(
        bench_scene(detection="snr", classification={"model": "spectral", "launches": 8}),
        overrides=["sensors[0].minimum_elevation_deg=83"],
    )
    with pytest.raises(ModelError, match=r"classification: spectral.* the sensor BENCH-1, .*paper"):
        opir.simulate(scene)


def test_posteriors_need_a_classifier_with_probabilities() -> None:
    context = ModelContext(sensors=(), target_type_code=np.zeros(0, np.uint8))
    with pytest.raises(
        ModelError, match="choose classification: spectral, or confidence: weighted"
    ):
        posterior_confidence(PosteriorConfig(), context)
