"""`train`, `adapt`: from checked models to an adapted policy."""

from __future__ import annotations

import typer


def register(app: typer.Typer) -> None:
    """Add these verbs."""
