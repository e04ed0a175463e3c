"""The contracts, one for each kind of component."""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from opir_core.testing.contracts.contract import Contract

#: By hook, the module of this package and the class of its contract.
HOMES: Mapping[str, tuple[str, str]] = {
    "opir_constellations": ("sensors", "ConstellationContract"),
    "opir_sensor_models": ("sensors", "SensorContract"),
    "opir_detection_models": ("detection", "DetectionContract"),
    "opir_confidence_models": ("confidence_and_classifiers", "ConfidenceContract"),
    "opir_classifiers": ("confidence_and_classifiers", "ClassifierContract"),
    "opir_trackers": ("trackers", "TrackerContract"),
    "opir_target_models": ("targets", "TargetContract"),
    "opir_signature_models": ("emitters", "SignatureContract"),
    "opir_source_models": ("emitters", "SourceContract"),
    "opir_atmosphere_models": ("atmospheres_and_backgrounds", "AtmosphereContract"),
    "opir_background_models": ("atmospheres_and_backgrounds", "BackgroundContract"),
    "opir_event_encoders": ("outputs", "EncoderContract"),
    "opir_sinks": ("outputs", "SinkContract"),
}


def contract_of(hook: str) -> "type[Contract]":
    """Return the contract of the components of a hook."""
    module, name = HOMES[hook]
    contract: type[Contract] = getattr(import_module(f"{__name__}.{module}"), name)
    return contract
