"""The settings of a training run, validated once and written beside its result."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from merap.learning.advantages import Baseline
from merap.learning.policy import Activation


class TrainingConfig(BaseModel):
    """What `train` does; the defaults are those of the documentation and of every figure in it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    estimator: Literal["exact"] = Field(
        default="exact", description="meta-gradients through the exact values of the known models"
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
    learning_rate: float = Field(default=1e-2, gt=0, description="beta, of Adam over the meta policy")
    step_size_learning_rate: float = Field(
        default=2e-2, ge=0, description="of Adam over step sizes; 0 keeps them"
    )
    final_learning_rate: float = Field(
        default=0.1, gt=0, le=1, description="both rates fall to this part of themselves along a cosine"
    )
    max_gradient_norm: float = Field(default=10.0, gt=0, description="an outer gradient is cut to this norm")
    inner_steps: int = Field(default=1, ge=1, description="gradient steps per model (eq:adap)")
    step_size: float = Field(default=0.5, gt=0, description="alpha, where the learned step sizes begin")
    order: Literal[1, 2] = Field(default=2, description="2: through the inner steps; 1: first-order MAML")
    episodes: int = Field(default=35, ge=1, description="K, episodes of an inner step")
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
