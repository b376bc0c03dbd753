"""The settings of a training run, validated once and written beside its result."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)

from merap.concerns.document import key_text
from merap.concerns.validation import message
from merap.errors import InputError
from merap.program.names import suggestion

Activation = Literal["relu", "tanh", "softplus"]
Baseline = Literal["linear", "time", "none"]
Estimator = Literal["exact", "sampled"]
Span = Literal["horizon", "infinite"]

# Where the paper's Algorithm 1 as its authors ran it differs from the defaults of `exact`.
SAMPLED_DEFAULTS: Mapping[str, Any] = {
    "outer": "trpo",
    "updates": 80,
    "tasks_per_update": 10,
    "step_size_learning_rate": 0.0,
    "ridge": 1e-5,
    "variance_prior": 0.0,
    "noise_episodes": 0.0,
    "entropy": 0.0,
    "exploration": 0.0,
}


class TrainingConfig(BaseModel):
    """What `train` does; the defaults are those of the documentation and of every figure in it.

    Raises:
        InputError: a setting is unknown, or has a value that is not allowed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """Yield the settings that are not the defaults of their estimator."""
        defaults = type(self)(estimator=self.estimator)
        for name, value in self:
            if value != (
                type(self).model_fields[name].default if name == "estimator" else getattr(defaults, name)
            ):
                yield name, value

    estimator: Estimator = Field(
        default="exact",
        description="exact: meta-gradients through the values of the known models; sampled: the paper's "
        "Algorithm 1, from episodes alone",
    )
    seed: int = Field(default=0, ge=0, le=2**63 - 1, description="of everything random")
    updates: int = Field(default=150, ge=1, description="outer updates (eq:meta-opt)")
    tasks_per_update: int = Field(default=16, ge=1, description="models drawn for an update, at most all")
    max_tasks: int = Field(
        default=512, ge=1, description="models of the base; of a larger support, that many"
    )
    observation: Literal["one_hot", "factored"] = Field(
        default="one_hot", description="what the policy sees: the state's number, or its variables encoded"
    )
    hidden: tuple[Annotated[int, Field(ge=1)], ...] = Field(
        default=(32, 32), description="sizes of the policy's hidden layers"
    )
    activation: Activation = Field(default="relu", description="between the layers")
    outer: Literal["adam", "sgd", "trpo"] = Field(default="adam", description="optimiser of the meta policy")
    outer_repeats: int = Field(
        default=1,
        ge=1,
        description="outer steps on what was drawn for one update (the paper's reading of RQ2)",
    )
    learning_rate: float = Field(default=1e-2, gt=0, description="beta, of adam and sgd over the meta policy")
    step_size_learning_rate: float = Field(
        default=2e-2, ge=0, description="of the inner step sizes; 0 keeps them"
    )
    final_learning_rate: float = Field(
        default=0.1, gt=0, le=1, description="both rates fall to this part of themselves along a cosine"
    )
    max_gradient_norm: float = Field(
        default=10.0, gt=0, description="an outer gradient is cut to this norm; not by trpo"
    )
    max_kl: float = Field(default=0.01, gt=0, description="trpo: bound on the divergence of a step, in nats")
    cg_iterations: int = Field(default=10, ge=1, description="trpo: of the conjugate gradient method")
    cg_damping: float = Field(default=1e-5, ge=0, description="trpo: added to the Fisher matrix's diagonal")
    backtracks: int = Field(default=15, ge=1, description="trpo: lengths of a step that are tried")
    backtrack_ratio: float = Field(
        default=0.8, gt=0, lt=1, description="trpo: of one such length to the next"
    )
    inner_steps: int = Field(default=1, ge=1, description="chained gradient steps per model (eq:adap)")
    step_size: float = Field(default=0.5, gt=0, description="alpha, where the learned step sizes begin")
    order: Literal[1, 2] = Field(default=2, description="2: through the inner steps; 1: first-order MAML")
    episodes: int = Field(default=35, ge=1, description="K, episodes of an inner step")
    sampling_noise: bool = Field(
        default=True, description="exact: inner steps carry the sampling noise of K episodes"
    )
    span: Span = Field(
        default="horizon",
        description="exact: the return over the horizon, or the discounted one of episodes without end",
    )
    baseline: Baseline = Field(default="linear", description="of the advantages")
    ridge: float = Field(default=1.0, gt=0, description="regularisation of the linear baseline")
    gae_lambda: float = Field(default=1.0, ge=0, le=1, description="of generalised advantage estimation")
    variance_prior: float = Field(
        default=10.0,
        ge=0,
        description="when advantages are normalised, their variance in training counts as that many episodes",
    )
    noise_episodes: float = Field(
        default=20.0,
        ge=0,
        description="n: with B instead of K episodes a step is (1 + n / K) / (1 + n / B) times as long",
    )
    entropy: float = Field(
        default=0.75,
        ge=0,
        description="weight of the meta policy's entropy, so that it goes on trying things; the unit is the "
        "advantages' standard deviation",
    )
    final_entropy: float = Field(
        default=0.05, ge=0, le=1, description="the weight falls to this part of itself"
    )
    exploration: float = Field(
        default=0.1, ge=0, lt=1, description="uniform part of the policy that samples episodes online"
    )
    patience: int = Field(
        default=0, ge=0, description="stop when that many updates brought nothing; 0: never"
    )
    least_gain: float = Field(
        default=1e-3,
        ge=0,
        lt=1,
        description="what counts as a gain of the adapted return, in units of how far it has moved so far",
    )
    tensorboard: bool = Field(default=False, description="also write metrics for TensorBoard")

    @model_validator(mode="wrap")
    @classmethod
    def _in_plain_words(cls, settings: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            return handler(settings)
        except ValidationError as error:
            raise _refusal(error) from error

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_the_estimator(cls, settings: Any) -> Any:
        if isinstance(settings, Mapping) and settings.get("estimator") == "sampled":
            return {**SAMPLED_DEFAULTS, **settings}
        return settings


def _refusal(error: ValidationError) -> InputError:
    """Return pydantic's first complaint in plain words."""
    details = error.errors(include_url=False)[0]
    key = key_text(details["loc"])
    if details["type"] == "extra_forbidden":
        return InputError(f"unknown setting{suggestion(key, TrainingConfig.model_fields)}", key=key)
    return InputError(message(details), key=key)
