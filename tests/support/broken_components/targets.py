"""Broken target models."""

from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import frozen

from broken_components.offers import mutant
from opir_core.arrays import FloatArray
from opir_core.builtin.configs import BallisticConfig
from opir_core.builtin.targets import ballistic_targets
from opir_core.plugin import TargetModel


@frozen(eq=False)
class OwnTargets:
    """The built-in targets with other positions."""

    made: Any
    change: Callable[[Any, FloatArray, Any, FloatArray], FloatArray]

    def __getattr__(self, name):
        return getattr(self.__getattribute__("made"), name)

    def __reduce__(self):
        return (OwnTargets, (self.made, self.change))

    def position_ecef_m(self, target, time_s):
        return self.change(self.made, self.made.position_ecef_m(target, time_s), target, time_s)

    def truth(self):
        return self.made.truth()


def target_mutant(name, caught_by):
    """Offer a target model made of the built-in one."""

    def offered(change):
        def build(configs, context):
            return OwnTargets(ballistic_targets(configs, context), change)

        mutant(TargetModel, name, caught_by, BallisticConfig)(build)
        return change

    return offered


@target_mutant("burns-for-ever", "test_positions_are_finite_during_the_burn_only")
def burns_for_ever(model, _place, target, time_s):
    return model.position_ecef_m(
        target, np.clip(time_s, model.ignition_s[target], model.burnout_s[target])
    )


@target_mutant("jumps", "test_paths_are_above_the_ground_and_smooth")
def jumps(model, place, target, time_s):
    return place + np.where(time_s - model.ignition_s[target] > 30.0, 5e4, 0.0)[:, None]


@target_mutant("led-astray", "test_free_flight_extends_to_end_s_and_burns_do_not_change")
def led_astray(model, place, _target, _time_s):
    return place if model.coast is None else place + 1.0


@target_mutant("swarm", "test_positions_are_independent")
def swarm(_product, place, _target, _time_s):
    return place + 1e-3 * (place - np.nanmean(place, axis=0)) if len(place) else place


@target_mutant("flies-by-number", "test_targets_are_independent")
def flies_by_number(_product, place, target, _time_s):
    return place + 10.0 * target[:, None]


@frozen(eq=False)
class BurnsTwice(OwnTargets):
    """Targets with a second burn that ends after burnout."""

    @property
    def burns_s(self):
        burn = np.stack([self.ignition_s, self.burnout_s], axis=-1)
        return np.stack([burn, burn + 1e3], axis=1)


@mutant(
    TargetModel, "burns-twice", "test_burns_are_in_order_from_ignition_to_burnout", BallisticConfig
)
def burns_twice(configs, context):
    return BurnsTwice(
        ballistic_targets(configs, context), lambda _product, place, _target, _time_s: place
    )


@frozen(eq=False)
class BurnsOfOneMore(OwnTargets):
    """Targets with the burns of one that is not there."""

    @property
    def burns_s(self):
        burns = np.stack([self.ignition_s, self.burnout_s], axis=-1)[:, None, :]
        return np.concatenate([burns, burns[-1:]])


@mutant(
    TargetModel,
    "burns-of-one-more",
    "test_burns_are_in_order_from_ignition_to_burnout",
    BallisticConfig,
)
def burns_of_one_more(configs, context):
    return BurnsOfOneMore(
        ballistic_targets(configs, context), lambda _product, place, _target, _time_s: place
    )
