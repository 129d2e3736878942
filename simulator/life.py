"""Makes the course of a simulation on a wire: the arm, the hand that moves it, the heat."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

from armd.simulator.live.electronics import ArmParts, Electronics
from armd.simulator.live.operator import Hand, Operator
from armd.simulator.live.physics import Block, WarmUp, generate_blocks
from armd.simulator.live.scenario import Scenario
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import JOINTS


@dataclass(frozen=True)
class Life:
    """The future course of an arm, and its electronics."""

    serial_number: str
    blocks: Iterator[Block]
    electronics: Electronics


def start_life(scenario: Scenario, rate_hz: int, options: argparse.Namespace) -> Life:
    """Make the physics of a scenario, *rate_hz* times a second.

    Raises `ArmdError` for an impossible plan, plant or twin.
    """
    warm_up = None
    if scenario.warm_up_k is not None:
        warm_up = WarmUp(scenario.warm_up_k, scenario.warm_up_s or scenario.seconds or 20.0)
    if options.twin is not None:
        return _begin_twin(scenario, rate_hz, options, warm_up)
    arm = TrueArm.default(scenario.seed, joints=scenario.joints or len(JOINTS))
    if options.plant:
        from armd.simulator.plants.live import plant_in_arm  # loaded late: the wire must not wait

        arm = plant_in_arm(arm, options.plant, scenario.seed)
    hand: Hand = Operator(arm, scenario.seed)
    if options.operator is not None:
        from armd.simulator.live.led import LedOperator, load_plan

        hand = LedOperator(arm, load_plan(options.operator), scenario.seed)
    parts = ArmParts.for_demo_arm(arm.n_joints)
    physics = generate_blocks(arm, hand, rate_hz, scenario.ambient_c, warm_up)
    return Life(scenario.serial_number, physics, Electronics(scenario.seed, parts))


def _begin_twin(
    scenario: Scenario, rate_hz: int, options: argparse.Namespace, warm_up: WarmUp | None
) -> Life:
    """Make the course of a twin; raises `ArmdError` for invalid files."""
    from armd.simulator.twin import arm as twins  # loaded late: the wire must not wait
    from armd.simulator.twin.files import read_twin
    from armd.simulator.twin.model import TwinModel
    from armd.simulator.twin.noise import FoundNoise, read_noise

    noise = FoundNoise() if options.noise_from is None else read_noise(options.noise_from)
    model = TwinModel(*read_twin(options.arm, options.twin))
    parts = twins.make_parts(model.arm, noise, "can" if options.can else "serial")
    twin = twins.TwinArm(model, noise, scenario.seed)
    comfort = twins.find_comfort(model.arm)
    hand: Hand
    if options.operator is None:
        hand = Operator(twin, scenario.seed, comfort)
    else:
        from armd.simulator.live.led import LedOperator, load_plan

        led = load_plan(options.operator)
        if noise.repeat_mm:
            plan = led.plan.model_copy(update={"miss_um": 1e3 * noise.repeat_mm})
            led = replace(led, plan=plan)
        hand = LedOperator(twin, led, scenario.seed, (comfort.low, comfort.high))
    physics = twins.generate_twin_blocks(
        twin, hand, rate_hz, twins.TwinHeat(twin, scenario.ambient_c, warm_up)
    )
    electronics = Electronics(scenario.seed, parts)
    return Life(model.arm.serial_number, physics, electronics)
