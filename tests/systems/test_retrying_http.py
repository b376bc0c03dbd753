"""Retries over a connection with mishaps: no step is lost or made twice."""

from __future__ import annotations

import numpy as np
import pytest

from merap.systems.interface import ManagedSystem
from merap.systems.retrying import Retries, RetryingSystem
from merap.systems.served_dialect import open_served
from tests.support.hand_made import cells, grid_combination
from tests.support.http_servers import FlakyServer, Mishap, raw_server, served_system


def mishaps(generator: np.random.Generator, share: float, count: int) -> list[Mishap]:
    kinds: list[Mishap] = ["none", "lost", "answer lost", "failed", "rubbish"]
    drawn = generator.choice(5, count, p=[1 - share, *[share / 4] * 4])
    return [kinds[index] for index in drawn]


def play(guarded: ManagedSystem, generator: np.random.Generator, episodes: int) -> tuple[list[str], float]:
    """Random episodes: the actions that were taken, by what is observed, and what they have earned."""
    taken, earned = [], 0.0
    for _ in range(episodes):
        found = guarded.reset()
        while not found.last:
            action = int(generator.choice(np.flatnonzero(found.enabled)))
            found = guarded.step(action)
            taken.append(guarded.actions[action if found.taken is None else found.taken])
            earned += found.reward
    return taken, earned


def test_no_step_is_lost_or_made_twice_however_bad_the_connection() -> None:
    """Every third request has a mishap; what the manager saw is what the server did, step for step."""
    generator = np.random.default_rng(7)
    executed: list[str] = []
    earned = 0.0
    served = served_system(grid_combination(blocked=cells((1, 1)), goal=(3, 3)))
    original = served.execute

    def recording(request: object) -> dict[str, object]:
        nonlocal earned
        before = served.monitor()
        done = original(request)
        after = served.monitor()
        if (after["episode"], after["step"]) != (before["episode"], before["step"]) and after["step"]:
            executed.append(str(after["action"]))
            earned += float(after["reward"])
        return done

    served.execute = recording  # type: ignore[method-assign]
    server = FlakyServer(served, iter(mishaps(generator, 1 / 3, 5000)))
    server.mishaps, later = iter(()), server.mishaps
    with raw_server(server) as url, open_served(url, timeout=10) as system:
        server.mishaps = later
        guarded = RetryingSystem(system, retries=Retries(20, 0.0, 0.0), fallback="stop")
        taken, seen_earned = play(guarded, generator, episodes=4)
    assert taken == executed
    assert seen_earned == pytest.approx(earned)
    assert len(taken) > 40
