"""What the broken components offer to the plugin host, and the contract test that is to find
each.
"""

from typing import Any

from opir_core.plugin import NoConfig

#: The contract test that is to find each mutant: (kind, name) to the test's name.
CAUGHT_BY: dict[tuple[str, str], str] = {}

#: What the mutants of trackers and detection models are made of; nothing is to be found in these.
SOUND = {
    ("opir_trackers", "sound-tracker"),
    ("opir_trackers", "sound-regions"),
    ("opir_trackers", "sound-conditions"),
    ("opir_trackers", "sound-hypotheses"),
    ("opir_detection_models", "sound-detection"),
}

_MADE: dict[str, list[Any]] = {}


def mutant(kind, name, caught_by, config=NoConfig, **fields):
    """Offer what is decorated as `build` of a component, with further fields, which a test is to
    catch.
    """

    def offered(build):
        CAUGHT_BY[kind.hook, name] = caught_by
        component = kind(name=name, summary=f"mutant: {name}", build=build, config=config, **fields)
        _MADE.setdefault(kind.hook, []).append(component)
        return build

    return offered


def offered(hook):
    """Return the components of a kind, by the name of its hook."""
    return _MADE.get(hook, [])
