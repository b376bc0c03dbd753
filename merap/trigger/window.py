"""The paper's trigger: sum of gamma^t r^t over a window, against TR; t counts from the window's start."""

from __future__ import annotations

from collections import deque

from merap.trigger.settings import WindowSettings
from merap.trigger.trigger import Alarm, Reading


class WindowTrigger:
    """Re-plan if a window's discounted reward is below the threshold (the paper, section 4.2).

    A reward that is not known can't be summed: an episode with a missed step is not judged, and a window
    of so many steps begins anew after it.

    Args:
        settings: threshold and window.
    """

    def __init__(self, settings: WindowSettings) -> None:
        self._settings = settings
        self._rewards: deque[float] = deque(maxlen=settings.steps)
        self._whole = True

    def observe(self, reading: Reading) -> Alarm | None:
        """Take in a step; an alarm at the end of a window that earned too little."""
        self._rewards.append(reading.reward)
        return self._judge() if len(self._rewards) == self._settings.steps else None

    def missed(self) -> None:
        """No window has this step."""
        self._rewards.clear()
        self._whole = False

    def episode_over(self) -> Alarm | None:
        """An alarm if the episode is the window and earned too little."""
        if self._settings.steps is not None:
            return None
        judged = self._whole and len(self._rewards) > 0
        self._whole = True
        alarm = self._judge() if judged else None
        self._rewards.clear()
        return alarm

    def _judge(self) -> Alarm | None:
        """The window ends here."""
        earned = sum(reward * self._settings.per_step**t for t, reward in enumerate(self._rewards))
        steps = len(self._rewards)
        if not self._settings.sliding:
            self._rewards.clear()
        if earned >= self._settings.threshold:
            return None
        reason = (
            f"the discounted reward of the last {steps} steps is {earned:.4g}, "
            f"below the threshold of {self._settings.threshold:.4g}"
        )
        return Alarm("threshold", earned, self._settings.threshold, reason)

    def replanned(self) -> None:
        """A new window begins."""
        self._rewards.clear()
        self._whole = True
