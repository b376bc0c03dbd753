"""From settings to a trigger."""

from __future__ import annotations

from merap.online.trigger.change import ChangeTrigger
from merap.online.trigger.settings import ChangeSettings, NoTrigger, WindowSettings
from merap.online.trigger.trigger import Trigger
from merap.online.trigger.window import WindowTrigger


def make_trigger(settings: ChangeSettings | WindowSettings | NoTrigger) -> Trigger | None:
    """The trigger that the settings describe; None: never re-plan."""
    if isinstance(settings, ChangeSettings):
        return ChangeTrigger(settings)
    if isinstance(settings, WindowSettings):
        return WindowTrigger(settings)
    return None
