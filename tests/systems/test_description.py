from __future__ import annotations

from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from merap.families.loading import load_case
from merap.mapek.serving import served_combination
from merap.systems.description import (
    Interface,
    ShownVariable,
    adaptation_options,
    adaptation_options_schema,
    execute_schema,
    interface_of,
    monitor_schema,
    read_interface,
)
from tests.support.hand_made import grid_combination

RUNNING = "models/running-example"
OWN = Interface(
    "own",
    ("go", "stay"),
    (ShownVariable("x", -3, 4), ShownVariable("y", -1, 1, ("low", "high"))),
    ("eye",),
    7,
)


@pytest.mark.parametrize(
    "interface",
    [
        OWN,
        replace(OWN, horizon=None, detectors=()),
        interface_of(grid_combination(), detect=True),
        interface_of(load_case(RUNNING).system("met"), detect=True),
    ],
    ids=["own", "unlimited", "grid", "running"],
)
def test_what_is_served_of_an_interface_can_be_read_back(interface: Interface) -> None:
    options, schema = adaptation_options(interface), monitor_schema(interface)
    assert read_interface(interface.system, options, schema) == interface
    jsonschema.validate(options, adaptation_options_schema(interface))


@pytest.mark.parametrize(
    ("options", "schema"),
    [
        ({}, monitor_schema(OWN)),
        ({"action": {"values": []}}, monitor_schema(OWN)),
        ({"action": {"values": [1, 2]}}, monitor_schema(OWN)),
        (adaptation_options(OWN), {}),
        (adaptation_options(OWN), {"properties": {"valuation": {"type": "object"}}}),
        (adaptation_options(OWN), {"properties": {"valuation": {"properties": {"x": {"minimum": "a"}}}}}),
    ],
)
def test_what_is_no_interface_is_refused(options: dict[str, object], schema: dict[str, object]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        read_interface("other", options, schema)


def test_every_body_of_random_episodes_is_as_the_schemas_say() -> None:
    """The schemas allow no other keys, so nothing is missing in them either."""
    met = load_case(RUNNING).system("met")
    served = served_combination(met, np.random.default_rng(0))
    monitored = jsonschema.Draft202012Validator(monitor_schema(served.interface))
    executed = jsonschema.Draft202012Validator(execute_schema(served.interface))
    generator = np.random.default_rng(1)
    for _ in range(3):
        executed.validate(served.execute({"reset": True}))
        while True:
            seen = served.monitor()
            monitored.validate(seen)
            if seen["truncated"] or seen["continuation"] == 0:
                break
            executed.validate(served.execute({"action": str(generator.choice(seen["enabled"]))}))


@pytest.mark.parametrize(
    "wrong",
    [
        {"valuation": {"row": 9, "col": 0, "mode": 0}},
        {"enabled": ["fly"]},
        {"enabled": ["up", "up"]},
        {"reward": "much"},
        {"continuation": 2},
        {"action": "fly"},
        {"step": 19},
        {"episode": 0},
    ],
)
def test_the_schema_refuses_what_can_not_be(wrong: dict[str, object]) -> None:
    served = served_combination(grid_combination(), np.random.default_rng(0))
    validator = jsonschema.Draft202012Validator(monitor_schema(served.interface))
    validator.validate(served.monitor())
    assert not validator.is_valid({**served.monitor(), **wrong})
