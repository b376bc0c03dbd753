"""From settings to a trigger."""

from __future__ import annotations

from merap.trigger.change import ChangeTrigger
from merap.trigger.settings import ChangeSettings, WindowSettings
from merap.trigger.trigger import Trigger
from merap.trigger.window import WindowTrigger


def make_trigger(settings: ChangeSettings | WindowSettings | None, discount: float) -> Trigger | None:
    """The trigger that the settings describe.

    Args:
        settings: None: never re-plan.
        discount: of a step, as the case has it.
    """
    if isinstance(settings, ChangeSettings):
        return ChangeTrigger(settings)
    if isinstance(settings, WindowSettings):
        given = settings.discount is not None
        return WindowTrigger(settings if given else settings.model_copy(update={"discount": discount}))
    return None
