"""Contracts bite: each broken component is caught by the test that is named for its fault."""

import broken_components
import pytest
from opir_testing import ConformanceError, Contract
from opir_testing.contracts import contract_for

MUTANTS = sorted(
    (mutant, test)
    for mutant, test in broken_components.CAUGHT_BY.items()
    if mutant not in broken_components.SOUND
)


def contract_of_mutant(hook: str, name: str) -> type[Contract]:
    return contract_for(hook, name, {}, {}, ("broken_components",))


def test_there_are_many() -> None:
    assert len(MUTANTS) >= 25
    assert {hook for (hook, _), _ in MUTANTS} >= {
        "opir_sensor_models",
        "opir_detection_models",
        "opir_confidence_models",
        "opir_classifiers",
        "opir_trackers",
        "opir_tracker_parts",
        "opir_target_models",
        "opir_event_encoders",
        "opir_sinks",
        "opir_metrics",
        "opir_executors",
        "opir_exporters",
        "opir_renderers",
        "opir_run_views",
    }


@pytest.mark.slow
@pytest.mark.parametrize(("mutant", "test"), MUTANTS, ids=[name for (_, name), _ in MUTANTS])
def test_a_mutant_is_caught_by_the_named_test(mutant: tuple[str, str], test: str) -> None:
    contract = contract_of_mutant(*mutant)
    with pytest.raises(Exception) as caught:  # noqa: PT011 - a fault may also be one that raises
        getattr(contract(), test)()
    assert isinstance(caught.value, ConformanceError) or mutant[1] in RAISING


#: Mutants whose fault raises of itself, before the contract can judge.
RAISING = {
    "afraid-of-the-empty",
    "closes-once",
    "replaces-its-file",
    "trips-over-nothing",
    "writes-to-its-input",
}


@pytest.mark.slow
def test_what_the_mutants_are_made_of_is_sound() -> None:
    """The trackers, sinks and models that mutants inherit keep their contracts, so each fault is
    the mutation's own.
    """
    from opir_testing.contracts import PASSED, conformance_results

    for hook, name in sorted(broken_components.SOUND):
        failed = [
            row
            for row in conformance_results(contract_of_mutant(hook, name))
            if row.state != PASSED
        ]
        assert not failed, (name, failed)
