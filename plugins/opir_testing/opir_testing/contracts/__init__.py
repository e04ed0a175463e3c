"""The conformance tests, one class for each kind of component, and a runner without pytest."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any

from attrs import frozen

from opir_core.errors import Problem, SceneError, nearest
from opir_testing.contracts.causes import cause_of, grouped_by_cause, seen_of
from opir_testing.contracts.contract import ConformanceError, Contract, requirement, test_names

#: The module and the class of the conformance tests of each hook.
HOMES: Mapping[str, tuple[str, str]] = {
    "opir_constellations": ("sensors", "ConstellationContract"),
    "opir_sensor_models": ("sensors", "SensorContract"),
    "opir_detection_models": ("detection", "DetectionContract"),
    "opir_confidence_models": ("confidence_and_classifiers", "ConfidenceContract"),
    "opir_classifiers": ("confidence_and_classifiers", "ClassifierContract"),
    "opir_trackers": ("trackers", "TrackerContract"),
    "opir_tracker_parts": ("tracker_parts", "TrackerPartContract"),
    "opir_directors": ("directors", "DirectorContract"),
    "opir_target_models": ("targets", "TargetContract"),
    "opir_target_classes": ("target_classes", "TargetClassContract"),
    "opir_signature_models": ("radiometry", "SignatureContract"),
    "opir_source_models": ("radiometry", "SourceContract"),
    "opir_atmosphere_models": ("radiometry", "AtmosphereContract"),
    "opir_background_models": ("radiometry", "BackgroundContract"),
    "opir_event_encoders": ("outputs", "EncoderContract"),
    "opir_sinks": ("sinks", "SinkContract"),
    "opir_renderers": ("renderers", "RendererContract"),
    "opir_readers": ("readers", "ReaderContract"),
    "opir_metrics": ("results", "MetricContract"),
    "opir_executors": ("results", "ExecutorContract"),
    "opir_exporters": ("results", "ExporterContract"),
    "opir_run_views": ("results", "RunViewContract"),
}


def contract_of(hook: str) -> type[Contract]:
    """Return the conformance tests of a hook's components."""
    module, name = HOMES[hook]
    return getattr(import_module(f"{__name__}.{module}"), name)


PASSED = "passed"
FAILED = "failed"
EXPECTED_FAILURE = "xfailed"
UNEXPECTED_PASS = "xpassed"

_SETTINGS = "The settings of the check are valid."

#: The first test: without a part there is nothing to test.
_BUILDS = "test_build_returns_a_complete_part"

#: States with which a component does not conform.
BAD = (FAILED, UNEXPECTED_PASS)


@frozen(kw_only=True)
class ConformanceResult:
    """The result of a conformance test.

    `state` is "passed", "failed", "xfailed" (an expected failure; `change` is its reason) or
    "xpassed" (passed, though a failure was expected). `cause` is what a failed test shows of its
    cause: results with one `cause`, and others that follow from it, are grouped by `by_cause`.
    """

    test: str
    requirement: str
    state: str
    seen: str = ""
    change: str = ""
    cause: str = ""


def contract_for(
    hook: str,
    name: str,
    settings: Mapping[str, Any],
    expected: Mapping[str, str],
    plugins: Sequence[str] = (),
) -> type[Contract]:
    """Return the conformance tests of a component; raises `SceneError` if `expected` names an
    unknown test.
    """
    parent = contract_of(hook)
    names = test_names(parent)
    for test in expected:
        if test not in names:
            raise SceneError(
                [Problem(test, f"{parent.__name__} has no such test{nearest(test, names)}")],
                source="--expect",
            )
    methods = {
        "name": name,
        "settings": settings,
        "expected_failures": expected,
        "plugins": tuple(plugins),
    }
    return type(parent.__name__, (parent,), methods)


def conformance_results(contract: type[Contract]) -> Iterator[ConformanceResult]:
    """Yield the result of each conformance test; only the first if settings or part are invalid."""
    try:
        contract.config()
    except ConformanceError as error:
        yield ConformanceResult(
            test="settings",
            requirement=_SETTINGS,
            state=FAILED,
            seen=error.seen,
            change=error.change,
            cause=_SETTINGS,
        )
        return
    for test in test_names(contract):
        result = _result(contract, test)
        yield result
        if (
            test == _BUILDS and result.state == FAILED
        ):  # each test that follows would fail by this alone
            return


def _result(contract: type[Contract], test: str) -> ConformanceResult:
    reason = contract.expected_failures.get(test)
    subject = {"test": test, "requirement": requirement(contract, test)}
    try:
        getattr(contract(), test)()
    except (Exception, SystemExit) as error:
        seen = seen_of(error)
        if reason is not None:
            return ConformanceResult(**subject, state=EXPECTED_FAILURE, seen=seen, change=reason)
        cause = cause_of(error)
        return ConformanceResult(
            **subject, state=FAILED, seen=seen, change=_change(error), cause=cause
        )
    if reason is None:
        return ConformanceResult(**subject, state=PASSED)
    return ConformanceResult(
        **subject,
        state=UNEXPECTED_PASS,
        seen="it passes",
        change=f"Remove the expected failure ({reason}).",
        cause=f"expected: {test}",
    )


def by_cause(results: Iterable[ConformanceResult]) -> Sequence[Sequence[ConformanceResult]]:
    """Return the results of a component that are bad, in a row for each cause; the first of a row
    tells it best, the others follow from it.
    """
    bad = {result.test: result for result in results if result.state in BAD}
    groups = grouped_by_cause((test, result.cause) for test, result in bad.items())
    return [[bad[test] for test in tests] for tests in groups]


def _change(error: BaseException) -> str:
    if isinstance(error, ConformanceError):
        return error.change
    if "read-only" in str(error):
        return "The engine owns the columns of its arguments: copy a column before you change it."
    return "Correct the code that raises this error."
