"""Whatever an environment does is an input error while it is made, and a fault of the system from then on."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from merap.errors import InputError
from merap.systems.gymnasium import GymnasiumSystem
from merap.systems.gymnasium_numbers import numbers_of, variables_of
from merap.systems.interface import Observation, SystemFault
from merap.systems.served import ServedSystem
from tests.support.faulty_lake import FAULTS, RAISED, FaultyLake

DOWN = 1
OF_RESET = [fault for fault in FAULTS if fault.startswith(("raised", "observation", "info", "shape"))]


def lake(fault: str, call: str = "step", *calls: int, **more: Any) -> FaultyLake:
    return FaultyLake(fault, call, calls or (1,), is_slippery=False, **more)


def walked(system: GymnasiumSystem) -> Observation:
    """After a reset and a step down, whatever befalls a second one."""
    system.reset()
    return system.step(DOWN)


def one_line(error: Exception) -> str:
    text = str(error)
    assert "\n" not in text
    assert len(text) < 700
    return text


@pytest.mark.parametrize("fault", FAULTS)
def test_a_step_that_fails_or_answers_what_is_not_declared_is_a_fault_and_the_episode_goes_on(
    fault: str,
) -> None:
    system = GymnasiumSystem(lake(fault))
    walked(system)
    with pytest.raises(SystemFault) as error:
        system.step(DOWN)
    assert error.value.kind == ("failed" if fault.startswith("raised") else "malformed")
    assert not error.value.repeatable  # it may have acted
    assert "FaultyLake: step: " in one_line(error.value)
    if fault.startswith(("raised", "reward")):
        assert not system.step(2).last
    assert walked(system).valuation.tolist() == [1, 0]


@pytest.mark.parametrize("fault", OF_RESET)
def test_a_reset_that_fails_or_answers_what_is_not_declared_is_a_fault_and_may_be_repeated(
    fault: str,
) -> None:
    system = GymnasiumSystem(lake(fault, "reset"), seed=3)
    walked(system)
    with pytest.raises(SystemFault, match="FaultyLake: reset: ") as error:
        system.reset()
    assert error.value.repeatable
    one_line(error.value)
    with pytest.raises(InputError, match="reset the system first"):
        system.step(DOWN)
    assert walked(system).valuation.tolist() == [1, 0]


@pytest.mark.parametrize("name", RAISED)
def test_one_that_can_not_be_made_is_an_input_error(name: str) -> None:
    with pytest.raises(InputError) as error:
        GymnasiumSystem(
            "tests.support.faulty_lake:FaultyLake-v0",
            arguments={"fault": f"raised: {name}", "call": "make", "calls": [0]},
        )
    assert one_line(error.value).startswith(
        "Gymnasium can't make 'tests.support.faulty_lake:FaultyLake-v0': "
    )


@pytest.mark.parametrize(
    ("env", "arguments", "message"),
    [
        ("FrozenLake-v1", {"nonsense": 1}, "unexpected keyword argument 'nonsense'"),
        ("FrozenLake-v1", {"map_name": "9x9"}, "KeyError: '9x9'"),
        ("FrozenLake-v1", {"id": "x"}, "multiple values for argument 'id'"),
        ("FrozenLake-v0", {}, "deprecated"),
        ("no_such_module:Lake-v0", {}, "no_such_module"),
        ("", {}, "Malformed environment ID"),
    ],
)
def test_an_id_or_arguments_that_gymnasium_refuses_are_input_errors(
    env: str, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as error:
        GymnasiumSystem(env, arguments=arguments)
    one_line(error.value)


@pytest.mark.parametrize(
    "text",
    ["raise RuntimeError('no licence')", "import sys; sys.exit('no licence')", "def broken(:  # licence"],
)
def test_a_module_that_fails_when_it_is_imported_is_an_input_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    (tmp_path / "failing_module.py").write_text(text + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r"can't make 'failing_module:Lake-v0': .*licence") as error:
        GymnasiumSystem("failing_module:Lake-v0")
    one_line(error.value)


def test_what_is_made_and_can_not_be_managed_is_closed() -> None:
    closed: list[bool] = []

    class Continuous(gymnasium.Env[Any, Any]):
        observation_space = spaces.Box(0, 1, (2,), np.float32)
        action_space = spaces.Discrete(2)

        def close(self) -> None:
            closed.append(True)

    gymnasium.register("Continuous-v0", entry_point=lambda **_: Continuous())
    with pytest.raises(InputError, match="no space of whole numbers"):
        GymnasiumSystem("Continuous-v0")
    assert closed == [True]
    with pytest.raises(InputError, match="no space of whole numbers"):
        GymnasiumSystem(Continuous())
    assert closed == [True]  # whoever has made it closes it
    gymnasium.registry.pop("Continuous-v0")


@pytest.mark.parametrize("name", RAISED)
def test_one_that_fails_when_it_is_closed_is_told_and_that_is_all(
    name: str, caplog: pytest.LogCaptureFixture
) -> None:
    with GymnasiumSystem(lake(f"raised: {name}", "close", 0)) as system:
        walked(system)
    assert "failed: FaultyLake: close: " in caplog.text
    assert len(caplog.records) == 1


@pytest.mark.parametrize("call", ["reset", "step", "close"])
def test_what_it_warns_of_is_no_fault_and_told_once(call: str, caplog: pytest.LogCaptureFixture) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with GymnasiumSystem(lake("warns: ", call, *range(5))) as system:
            assert walked(system).valuation.tolist() == [1, 0]
            assert walked(system).valuation.tolist() == [1, 0]
    assert [record.getMessage() for record in caplog.records] == ["FaultyLake warns: the ice is thin"]


def test_an_interrupt_is_none_of_its_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RAISED, "interrupt", lambda answer: (_ for _ in ()).throw(KeyboardInterrupt))
    system = GymnasiumSystem(lake("raised: interrupt"))
    walked(system)
    with pytest.raises(KeyboardInterrupt):
        system.step(DOWN)


def test_an_end_with_an_observation_that_is_not_declared_is_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    env = lake("observation: too high", "step", 1, desc=["SF", "HG"])
    system = GymnasiumSystem(env)
    system.reset()
    system.step(2)
    with pytest.raises(SystemFault, match="malformed"):
        system.step(DOWN)
    with pytest.raises(InputError, match="the episode is over; reset"):
        system.step(DOWN)


def test_secrets_among_the_arguments_are_not_shown(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    for arguments in ({"api_key": "s3cret-key"}, {"url": "http://me:s3cret-key@host/x"}):
        with pytest.raises(InputError, match="unexpected keyword") as error:
            GymnasiumSystem("FrozenLake-v1", arguments=arguments)
        assert "s3cret" not in str(error.value)
    assert "s3cret" not in caplog.text


@pytest.mark.parametrize(
    ("space", "allowed", "refused"),
    [
        (
            spaces.Discrete(3, start=-1),
            [-1, 1, np.int8(0), True],
            [2, -2, 0.0, "0", None, [0], np.array([0])],
        ),
        (
            spaces.MultiDiscrete([2, 3]),
            [[1, 2], np.array([0, 0], np.uint8)],
            [[1, 3], [1.0, 2.0], [1], 1, [[1, 2]]],
        ),
        (spaces.MultiBinary(2), [[0, 1], np.array([True, False])], [[0, 2], [0.0, 1.0], [-1, 0], "01", [1]]),
        (spaces.Box(2, 5, (2,), np.int32), [[2, 5], np.array([3, 4])], [[1, 3], [3, 6], [3.5, 4], [2], None]),
        (spaces.Box(0, 255, (1, 2), np.uint8), [[[0, 255]]], [[[0, 256]], [[-1, 0]], [0, 1]]),
        (
            spaces.Dict({"a": spaces.Discrete(2), "b": spaces.MultiBinary(1)}),
            [{"b": [1], "a": 0}],
            [{"a": 0}, {"a": 0, "b": [1], "c": 1}, {"a": 2, "b": [1]}, [0, [1]], None],
        ),
        (
            spaces.Tuple((spaces.Discrete(2), spaces.Discrete(2))),
            [(0, 1), [1, 1]],
            [(0,), (0, 1, 0), (0, 2), {0: 0, 1: 1}, 3],
        ),
    ],
)
def test_what_a_space_does_not_allow_is_refused_and_never_cut_to_fit(
    space: gymnasium.Space[Any], allowed: list[Any], refused: list[Any]
) -> None:
    for seen in allowed:
        assert numbers_of(space, seen).dtype == np.int64
        assert len(numbers_of(space, seen)) == len(variables_of(space, "it"))
    for seen in refused:
        with pytest.raises(ValueError, match="the observation"):
            numbers_of(space, seen)


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (spaces.Box(0, 255, (210, 160, 3), np.uint8), "has 100800 numbers, at most 10000 are allowed"),
        (spaces.Box(0, 2**64 - 1, (1,), np.uint64), "beyond 64 bits"),
        (spaces.Text(3), "no space of whole numbers"),
    ],
)
def test_a_space_of_other_numbers_is_refused(space: gymnasium.Space[Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        variables_of(space, "it")


def test_a_fault_while_it_is_served_is_one_of_the_system() -> None:
    served = ServedSystem(system := GymnasiumSystem(lake("observation: too high")), system.interface)
    served.execute({"action": "down"})
    with pytest.raises(SystemFault, match="malformed: FaultyLake: step: the observation is 16"):
        served.execute({"action": "down"})
