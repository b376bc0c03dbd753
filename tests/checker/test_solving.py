"""Answers about properties of any shape, refused or right."""

from __future__ import annotations

import pytest

from merap.checker.storm import build_text
from merap.checker.storm_messages import UnsupportedPropertyError
from merap.checker.storm_model import StormModel
from merap.errors import InputError, ModelError
from tests.support.slow_chain import expected_steps, slow_chain

# Steps of -1 to c; to go on succeeds with 1/2, and to stop at c costs nothing. From a that is -4.
CHAIN = """mdp
module chain
  s : [0..2] init 0;
  [go] s<2 -> 1/2 : (s'=s+1) + 1/2 : true;
  [stop] s=2 -> true;
endmodule
label "goal" = s=2;
rewards "objective" [go] true : -1; endrewards
rewards "steps" s<2 : 1; endrewards
"""
OPERATORS = [
    'R{"objective"}max>=-3 [F "goal"]',
    'R{"objective"}min>=-3 [F "goal"]',
    'R{"objective"}>=-3 [F "goal"]',
    'R{"objective"}max>=-3 [C]',
    'R{"objective"}max>=-3 [F (P>=0.5 [F<=3 "goal"])]',
    'R{"objective"}max>=-3 [LRA]',
    'R{"objective"}max>=-3.5+1/2 [F "goal"]',
]
AROUND = [
    "{}",
    "{} | false",
    "false | {}",
    "({}) & true",
    "true & (true & {})",
    "!{}",
    "!({})",
    "!(!({}) & true)",
    '"goal" | !("goal" | {})',
    "P>=1 [F {}]",
    "Pmax=? [F ({})]",
    "Pmin>=0.5 [G ({})]",
    "Pmax=? [X ({})]",
    'Pmax=? [({}) U "goal"]',
    'P>=0.5 [F<=2 (({}) & "goal")]',
    'P>=0.5 [(F ({})) & (F "goal")]',
    "P>=0.5 [F P>=0.5 [X ({})]]",
    'R{{"steps"}}max<=9 [F ({})]',
    'R{{"steps"}}max=? [F ({})]',
    "LRAmax=? [({})]",
    "Tmax=? [F ({})]",
    'multi({}, P>=0.5 [F "goal"])',
    'filter(forall, {}, "init")',
    'filter(min, P>=0.5 [F ({})], "init")',
    '"name": {} | false',
    "// as a comment\n{} | false",
]


@pytest.fixture(scope="module")
def chain() -> StormModel:
    return build_text(CHAIN, "chain")


@pytest.mark.parametrize("around", AROUND)
def test_an_unbounded_sum_of_rewards_below_0_is_refused_wherever_it_stands(
    chain: StormModel, around: str
) -> None:
    for operator in OPERATORS:
        with pytest.raises(UnsupportedPropertyError, match=r"rewards 'objective' are below 0|multi\(\.\.\)"):
            chain.check(around.format(operator))


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        # ten steps: 1 - 11/1024 reach c, and the mean of the cost is just short of 4
        ('R{"objective"}max>=-3 [C<=10] | false', False),
        ('!R{"objective"}max>=-3 [C<=10]', True),
        ('R{"objective"}max>=-4 [C<=10] & true', True),
        # from b it is 2
        ('P>=1 [F (R{"objective"}max>=-3 [C<=10])]', True),
        ('P>=1 [X (R{"objective"}max>=-3 [C<=10])]', False),
        ('P>=0.5 [X (R{"objective"}max>=-3 [C<=10])]', True),
        ('P>0.5 [X (R{"objective"}max>=-3 [C<=10])]', False),
        # nothing is below 0 here
        ('R{"steps"}max<=3 [F "goal"] | false', False),
        ('R{"steps"}max<=4 [F "goal"] | false', True),
        ('R{"steps"}max<4 [F "goal"] | false', False),
        ('P>=1 [F R{"steps"}max<=2 [F "goal"]]', True),
        ('R{"steps"}max<=2 [F R{"steps"}max<=2 [F "goal"]]', True),
        ('R{"steps"}max<2 [F R{"steps"}max<=2 [F "goal"]]', False),
    ],
)
def test_a_bounded_sum_is_right_wherever_it_stands(chain: StormModel, text: str, holds: bool) -> None:
    assert chain.check(text).holds is holds


@pytest.mark.parametrize(
    ("text", "logic"),
    [
        ('multi(Pmax=? [F "goal"], P>=0.5 [F "goal"])', r"multi\(\.\.\)"),
        ('multi(P>=0.5 [F "goal"], P>=0.5 [F "goal"])', r"multi\(\.\.\)"),
        ('multi(P>=0.5 [F "goal"]) & true', r"multi\(\.\.\)"),
        ('multi(R{"steps"}min=? [F "goal"], P>=0.5 [F "goal"])', r"multi\(\.\.\)"),
        ('quantile(min A, Pmax>=0.5 [F{"steps"}<=A "goal"])', r"quantile\(\.\.\)"),
        ('<<1>> P>=0.3 [F "goal"]', "<<"),
    ],
)
def test_answers_without_bounds_of_other_logics_are_refused(chain: StormModel, text: str, logic: str) -> None:
    with pytest.raises(UnsupportedPropertyError, match=f"Storm has no single value for it.*{logic}"):
        chain.check(text)


def test_a_value_inside_another_property_is_refused(chain: StormModel) -> None:
    with pytest.raises(InputError, match="an operator inside another needs a bound"):
        chain.check('Pmax=? [F Pmax=? [F "goal"]]')


# 0.1 + 0.2 is more than 0.3 in doubles.
THIRDS = """mdp
module thirds
  s : [0..3] init 0;
  [go] s=0 -> 0.1 : (s'=1) + 0.2 : (s'=2) + 0.7 : (s'=3);
  [end] s>0 -> true;
endmodule
label "goal" = s=1 | s=2;
rewards "objective" s=1 : 1; s=2 : 1; s=3 : 0; endrewards
"""


@pytest.mark.parametrize("operator", ["P{} [F {}]", "P{} [X {}]", "P{} [F<=5 {}]", "P{} [!{} U {}]"])
@pytest.mark.parametrize("around", ["{}", "!({})", "P>=1 [X true] & {}"])
def test_a_bound_that_is_the_value_is_compared_exactly(operator: str, around: str) -> None:
    model = build_text(THIRDS, "thirds")
    for bound in ("0.3", "3/10", "1-7/10", "0.1+0.2"):
        for compare, holds in ((">=", True), (">", False), ("<=", True), ("<", False)):
            text = around.format(operator.format(compare + bound, '"goal"', '"goal"'))
            assert model.check(text).holds is (holds != around.startswith("!")), text


@pytest.mark.parametrize("bound", ["1/2", "2/4", "1-1/2", "(1/4)+(1/4)", "1/2/1", "3/2-1", "half/2"])
def test_a_division_in_a_bound_is_one_of_real_numbers(bound: str) -> None:
    model = build_text(THIRDS.replace("mdp\n", "mdp\nconst int half = 1;\n"), "thirds")
    assert model.check(f'Pmax>={bound} [F "goal"]').holds is False
    assert model.check(f'Pmax<{bound} [F "goal"]').holds is True
    assert model.check(f'P>=1 [X true] & Pmax>={bound} [F "goal"]').holds is False
    assert model.check(f'R{{"objective"}}max>={bound} [C<=2] // a/b').holds is False


@pytest.mark.parametrize("n", [1, 2, 5, 12, 14, 15, 16, 20, 31, 40, 100])
@pytest.mark.parametrize("kind", ["mdp", "dtmc"])
def test_a_slowly_mixing_chain_has_its_value(n: int, kind: str) -> None:
    model = build_text(slow_chain(n, kind), "slow")
    best = "max" if kind == "mdp" else ""
    reach = model.check(f'P{best}=? [F "goal"]')
    assert reach.value == pytest.approx(0.5, abs=1e-9)
    assert reach.lower is not None
    assert reach.upper is not None
    assert reach.lower <= 0.5 <= reach.upper
    assert reach.upper - reach.lower < 1e-9
    for compare, holds in ((">=", True), (">", False), ("<=", True), ("<", False)):
        assert model.check(f'P{compare}0.5 [F "goal"]').holds is holds
    assert model.check('P>=0.5 [F "goal"] & P<=0.5 [F "goal"]').holds is True
    assert model.check(f'P{best}=? [!"out" U "goal"]').value == pytest.approx(0.5, abs=1e-9)
    assert model.check(f'P{best}=? [F G "goal"]').value == pytest.approx(0.5, abs=1e-9)
    assert model.check(f'LRA{best}=? ["goal"]').value == pytest.approx(0.5, abs=1e-9)
    steps = model.check(f'R{{"steps"}}{best}=? [F "out"]').value
    assert steps == pytest.approx(expected_steps(n), rel=1e-9)


def test_a_discounted_sum_without_end_has_bounds(chain: StormModel) -> None:
    answer = chain.check('R{"objective"}max=? [Cdiscount=0.9]')
    exact = -400 / 121  # b = -1 / (1 - 0.45), a = (-1 + 0.45 b) / (1 - 0.45)
    assert answer.value == pytest.approx(exact, abs=1e-12)
    assert answer.lower is not None
    assert answer.upper is not None
    assert answer.lower <= exact <= answer.upper
    assert answer.upper - answer.lower < 1e-9
    assert chain.check('R{"objective"}max>=-3.31 [Cdiscount=9/10]').holds is True
    assert chain.check('R{"objective"}max>=-3.30 [Cdiscount=0.9]').holds is False
    assert chain.check('!R{"objective"}max>=0 [Cdiscount=0.9]').holds is True
    with pytest.raises(UnsupportedPropertyError, match="too close to -400/121"):
        chain.check('R{"objective"}max>=-400/121 [Cdiscount=0.9]')
    with pytest.raises(InputError, match="between 0 and 1"):
        chain.check('R{"objective"}max=? [Cdiscount=1]')


@pytest.mark.parametrize(
    "text",
    ['Pmax=? [F "goal" || F "goal"]', 'Pmax=? [F{"steps"}<=3 "goal"]'],
)
def test_forms_that_storm_lacks_are_unsupported(chain: StormModel, text: str) -> None:
    with pytest.raises(UnsupportedPropertyError):
        chain.check(text)


def test_a_model_that_depends_on_rounding_is_refused_where_fractions_decide() -> None:
    # 0.1 + 0.2 - 0.3 is 5.6e-17 in doubles: a branch that fractions do not have
    model = build_text(
        """mdp
module m
  s : [0..2] init 1;
  [go] s=1 -> 0.1*s+0.2*s-0.3*s : (s'=2) + 1 : (s'=0);
  [end] s!=1 -> true;
endmodule
label "goal" = s=2;
""",
        "m",
    )
    with pytest.raises(ModelError, match="depends on rounding"):
        model.check('Pmax>0 [F "goal"]')
