"""Gymnasium, an optional extra: imported here alone, so that its absence is told in one way."""

from __future__ import annotations

from merap.errors import InputError

try:
    import gymnasium
    from gymnasium.envs import toy_text
except ModuleNotFoundError as error:
    raise InputError("this needs Gymnasium, which is missing: pip install 'merap[gymnasium]'") from error

__all__ = ["gymnasium", "toy_text"]
