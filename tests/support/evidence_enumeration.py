"""Likelihoods of observations by enumeration: every hypothesis' own model, in fractions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from merap.errors import InputError
from merap.program.closing import closed
from merap.program.expressions import Value
from merap.program.form import Program
from tests.support.program_enumeration import BrokenError, State, enumerate_model, value_of

Choice = tuple[str | None, dict[State, Fraction]]


@dataclass(frozen=True)
class EnumeratedModel:
    """The model under one hypothesis."""

    program: Program
    initial: Mapping[State, float]
    choices: Mapping[State, list[Choice]]

    def start(self, state: State) -> float:
        return log(self.initial.get(state, 0))

    def enabled(self, state: State) -> set[str]:
        return {action for action, _ in self.choices[state] if action is not None}

    def step(self, state: State, action: str, target: State) -> float:
        """Commands of one action that are enabled together are equally likely."""
        found = [
            successors.get(target, Fraction(0)) for name, successors in self.choices[state] if name == action
        ]
        return log(sum(found) / len(found)) if found else -math.inf

    def label(self, name: str, state: State) -> bool | None:
        holds: bool | None = self._value(self.program.labels[name], self._scope(state, state))
        return holds

    def reward(self, structure: str, state: State, action: str | None, target: State) -> float | None:
        rewards, scope = self.program.rewards[structure], self._scope(state, target)
        earned = Fraction(0)
        for rule in rewards.rules:
            if rule.actions and action not in rule.actions:
                continue
            holds = self._value(rule.guard, scope)
            if holds is None:
                return None
            if holds:
                value = self._value(rule.value, scope)
                if value is None:
                    return None
                earned += value
                if rewards.first_match:
                    break
        return float(earned)

    def _scope(self, state: State, target: State) -> dict[str, Any]:
        names = [one.name for one in self.program.variables]
        after = {f"{name}'": value for name, value in zip(names, target, strict=True)}
        return dict(zip(names, state, strict=True)) | after

    def _value(self, expression: Any, scope: Mapping[str, Any]) -> Any:
        try:
            return value_of(expression, scope)
        except (ZeroDivisionError, IndexError):
            return None


def enumerated(program: Program, values: Mapping[str, Value]) -> EnumeratedModel | None:
    """Return the model with some values of parameters; None if there is none."""
    try:
        own = closed(program, values)
        return EnumeratedModel(own, *enumerate_model(own))
    except (BrokenError, InputError):
        return None


def log(probability: Fraction | float) -> float:
    return math.log(probability) if probability else -math.inf
