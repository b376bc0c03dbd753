from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from merap.checker.exchange import ModelText
from merap.checker.process import CheckingProcess, OverTimeError
from merap.errors import EngineError, InputError, ModelError
from tests.support.slow_chain import slow_chain

pytestmark = pytest.mark.process

ENDLESS = 'Pmax=? [F<=2000000000 "goal"]'


def text_of(n: int) -> ModelText:
    """The slow chain, begun in its middle."""
    return ModelText(f"chain {n}", slow_chain(n), ("s",), np.array([[n]]), np.array([1.0]))


def test_models_are_checked_one_after_the_other() -> None:
    with CheckingProcess(60) as process:
        for n in (1, 2, 3):
            process.begin(text_of(n))
            process.finish()
            # straight to one end
            assert process.check(f'Pmax=? [F<={n} "goal"]').value == 0.5**n
            assert process.check('Pmax>=0.5 [F "goal"]').holds is True


def test_a_property_over_its_time_is_ended_and_the_next_is_answered() -> None:
    with CheckingProcess(3) as process:
        process.begin(text_of(8))
        assert process.check('Pmax=? [F "goal"]').value == pytest.approx(0.5)
        with pytest.raises(OverTimeError) as raised:
            process.check(ENDLESS)
        assert str(raised.value) == f"chain 8: property {ENDLESS!r}: not done within 3 s"
        assert raised.value.exit_code == 3
        assert process.check('Pmax=? [F "goal"]').value == pytest.approx(0.5)
        process.begin(text_of(1))
        assert process.check('Pmax=? [F<=1 "goal"]').value == 0.5


def test_a_model_over_its_time_is_ended_too() -> None:
    with CheckingProcess(1e-6) as process:
        process.begin(text_of(8))
        with pytest.raises(OverTimeError, match="chain 8: building the model: not done within 1e-06 s"):
            process.finish()


@pytest.mark.parametrize("timeout", [0, -1, float("nan"), float("inf"), "5"])
def test_a_limit_that_is_none_is_refused(timeout: float) -> None:
    with pytest.raises(InputError, match=r"expected seconds above 0, at most 1e|expected a number"):
        CheckingProcess(timeout)


def test_errors_come_back_as_they_are_raised() -> None:
    with CheckingProcess(60) as process:
        process.begin(text_of(2))
        with pytest.raises(InputError, match="unknown label 'gaol'; did you mean 'goal'"):
            process.check('Pmax=? [F "gaol"]')
        process.begin(ModelText("m", "mdp\nmodule m\n", ("s",), np.array([[0]]), np.array([1.0])))
        with pytest.raises(InputError) as raised:
            process.finish()
        assert raised.value.source == "m"
        assert raised.value.line is not None
        short = slow_chain(2).replace("1/2 : (s'=s-1)", "1/4 : (s'=s-1)")
        process.begin(ModelText("m", short, ("s",), np.array([[2]]), np.array([1.0])))
        with pytest.raises(ModelError, match=r"sum to 0\.75"):
            process.finish()


def test_a_process_that_dies_is_one_error(capfd: pytest.CaptureFixture[str]) -> None:
    # Storm's parser runs out of stack, which ended the caller
    deep = "(" * 200_000 + "1" + ")" * 200_000
    with CheckingProcess(60) as process:
        text = slow_chain(2).replace("s<2 ", f"s<2 & {deep}=1 ")
        process.begin(ModelText("deep", text, ("s",), np.array([[2]]), np.array([1.0])))
        with pytest.raises(EngineError) as raised:
            process.finish()
        assert str(raised.value) == "deep: building the model: Storm's process died (SIGSEGV)"
        process.begin(text_of(1))
        assert process.check('Pmax=? [F<=1 "goal"]').value == 0.5
    assert capfd.readouterr() == ("", "")


def test_no_process_is_left() -> None:
    with CheckingProcess(60) as process:
        child = process._process
        process.begin(text_of(8))
    assert child.returncode is not None
    assert not Path(f"/proc/{child.pid}").exists()
