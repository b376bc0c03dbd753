"""Schema of a case whose models are PRISM text."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from merap.concerns.schema import CaseSpec, SystemSpec
from merap.concerns.schema_base import Name, Names, Number, Spec, wrong
from merap.concerns.schema_configurations import ConfiguredSpec
from merap.concerns.schema_objective import Horizon
from merap.program.form import ConcernName


class TextSpec(Spec):
    """Text in place of a file that holds it."""

    text: str = Field(description="the content")


Source: TypeAlias = str | TextSpec


def _source(value: object) -> object:
    return value if isinstance(value, str | dict | TextSpec) else _no_source()


def _no_source() -> object:
    raise wrong("expected the name of a file, or a mapping with the key text")


FileOrText = Annotated[Source, BeforeValidator(_source)]


class ProgramSpec(Spec):
    """The models as PRISM text."""

    file: FileOrText | None = Field(
        default=None, description="a PRISM MDP; constants that it leaves open are parameters of the concerns"
    )
    templates: dict[ConcernName, FileOrText] | None = Field(
        default=None, description="concern: a Jinja template of its modules, labels and rewards"
    )
    constants: dict[Name, bool | int | float] = Field(
        default={}, description="name: value of an open constant; templates get them by value"
    )
    owner: dict[ConcernName, Names] = Field(
        default={}, description="concern: its modules; the environment owns the others"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> ProgramSpec:
        if (self.file is None) == (not self.templates):
            raise wrong("expected either file or templates")
        if self.templates and self.owner:
            raise wrong("owner goes with file: a template's modules are its concern's", ("owner",))
        return self


class WrittenRewardSpec(Spec):
    """A reward rule; the first that matches counts."""

    action: Names | None = Field(default=None, description="an action or several")
    where: str | None = Field(default=None, description="a condition; x' reads x of the successor")
    value: Number = Field(description="a number or an expression; x' reads x of the successor")


class WrittenObjectiveSpec(ConfiguredSpec):
    """The objective: over the text's variables, constants, formulas and, in double quotes, its labels."""

    horizon: Horizon = Field(description="steps of an episode: a number, or a parameter")
    goal: str | None = Field(
        default=None, description="states to reach; by default those with the text's label goal"
    )
    ends_in: str | None = Field(default=None, description="states in which the task is complete")
    unsafe: str | None = Field(
        default=None, description="states to avoid; by default those with the text's label unsafe"
    )
    reward: str | None = Field(default=None, description="a reward structure of the text")
    sign: Literal[1, -1] = Field(default=1, description="-1: the structure counts costs")
    rewards: tuple[WrittenRewardSpec, ...] | None = Field(
        default=None, description="rules in place of a structure; no match earns 0"
    )
    properties: dict[Name, str] = Field(
        default={}, description="name: PRISM property; labels goal, done, unsafe, deadlock and the text's"
    )

    @model_validator(mode="after")
    def _one_reward(self) -> WrittenObjectiveSpec:
        if self.reward is not None and self.rewards is not None:
            raise wrong("expected either reward or rewards", ("rewards",))
        if self.reward is None and "sign" in self.model_fields_set:
            raise wrong("sign goes with reward", ("sign",))
        return self


class WrittenCaseSpec(Spec):
    """A case study whose models are PRISM text."""

    case: Name = Field(description="the name of the case study")
    discount: float = Field(default=1.0, gt=0, le=1, description="of a step")
    program: ProgramSpec = Field(description="the models")
    environment: ConfiguredSpec = Field(
        default=ConfiguredSpec(), description="what may be different around the system"
    )
    capability: ConfiguredSpec = Field(default=ConfiguredSpec(), description="what the system can do")
    objective: WrittenObjectiveSpec = Field(description="what the user wants")
    online: dict[Name, SystemSpec] = Field(default={}, description="name: a system that is met online")


def case_schema() -> dict[str, Any]:
    """The JSON Schema of a case file of either kind (draft 2020-12)."""
    definitions: dict[str, Any] = {}
    for kind in (CaseSpec, WrittenCaseSpec):
        schema = kind.model_json_schema(mode="validation")
        definitions |= schema.pop("$defs")
        definitions[kind.__name__] = schema
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "merap case file",
        "type": "object",
        "if": {"required": ["program"]},
        "then": {"$ref": "#/$defs/WrittenCaseSpec"},
        "else": {"$ref": "#/$defs/CaseSpec"},
        "$defs": definitions,
    }
