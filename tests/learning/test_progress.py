"""Plateaus and collapses, on returns made for the purpose."""

from __future__ import annotations

import math

import numpy as np

from merap.learning.progress import WINDOW, Progress


def test_nothing_is_known_before_the_first_window_is_full() -> None:
    progress = Progress([1.0] * (WINDOW - 1))
    assert progress.best_update == 0
    assert math.isnan(progress.best_score)
    assert not progress.collapsed
    assert progress.observe(1.0)
    assert (progress.best_update, progress.best_score) == (WINDOW, 1.0)


def test_a_rising_return_is_always_the_best() -> None:
    progress = Progress(np.arange(40.0).tolist())
    assert progress.best_update == 40
    assert progress.best_score == np.mean(np.arange(30.0, 40.0))
    assert progress.since_best == 0
    assert not progress.collapsed


def test_a_flat_return_brings_no_gain() -> None:
    progress = Progress([*np.arange(20.0), *[19.0] * 30])
    # the window is full of 19 after ten of them
    assert progress.best_update == 29
    assert progress.since_best == 50 - 29
    assert not progress.collapsed


def test_a_gain_must_be_worth_it() -> None:
    """One percent of the ground covered: 0.04 of 4."""
    rising = [*[0.0] * WINDOW, *[4.0] * WINDOW]
    small, large = Progress(rising, 0.01), Progress(rising, 0.01)
    for _ in range(WINDOW):
        small.observe(4.03)
        large.observe(4.05)
    assert small.best_update == 2 * WINDOW
    assert large.best_update > 2 * WINDOW


def test_a_fall_is_a_collapse() -> None:
    """-9 after 4: the collapse to the local optimum that the paper's world is known for."""
    progress = Progress([*np.linspace(-5, 4, 60), *[-9.0] * WINDOW])
    assert progress.collapsed
    assert progress.best_update == 60
    recovered = Progress([*np.linspace(-5, 4, 60), *[-9.0] * WINDOW, *[4.0] * WINDOW])
    assert not recovered.collapsed


def test_noise_is_no_collapse() -> None:
    """20 runs of 300 updates of white noise; a window's mean is compared with the best of 290.

    The best of so many means lies some 3 standard errors above the true one, a collapse takes 6 of the
    difference of two: none of 2,000 other seeds failed.
    """
    for seed in range(20):
        returns = np.random.default_rng(seed).standard_normal(300)
        assert not Progress(returns.tolist()).collapsed, seed


def test_the_same_returns_at_once_or_one_by_one() -> None:
    returns = np.random.default_rng(0).standard_normal(57).cumsum().tolist()
    at_once, one_by_one = Progress(returns, 0.01), Progress(least_gain=0.01)
    for value in returns:
        one_by_one.observe(value)
    assert vars(at_once) == vars(one_by_one)
