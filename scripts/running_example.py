"""The whole method on the running example: render, verify, train, adapt, draw. Used by scripts/demo."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import merap
from merap.cli.interruption import interruptible
from merap.concerns.lookup import declared
from merap.families import render_case
from merap.report import draw_adaptation, draw_before_after, most_likely_path, save_figure
from merap.strategies import Adaptation

ROOT = Path(__file__).parents[1]
OUT = ROOT / "demo-output"
SEEDS = range(5)


def main() -> None:
    begin = time.monotonic()
    shutil.rmtree(OUT, ignore_errors=True)
    case = merap.load_case(ROOT / "models" / "running-example")

    print("1. Three concerns, modelled separately, make", case.size, "combinations.")
    count = render_case(case, case.combinations(), OUT / "models")
    print(f"   {count} PRISM models are in {OUT.name}/models, for example:")
    text = (OUT / "models" / "b_blocked.speed_low.g1.prism").read_text()
    print("\n".join(f"   | {line[:96]}" for line in text[text.index("module capability") :].splitlines()[:9]))

    print("2. Storm builds and checks each of them.")
    verdicts = list(merap.verify(case))
    false = [verdict for verdict in verdicts if verdict.holds is False]
    rewards = [
        verdict.value for verdict in verdicts if verdict.name == "reward" and verdict.value is not None
    ]
    print(f"   {len(verdicts)} verdicts, {len(false)} false; the best discounted reward lies between")
    print(f"   {min(rewards):.2f} and {max(rewards):.2f} over the combinations.")

    print("3. One meta policy is trained over all. The first time, some of it goes into compiling.")
    seconds: list[float] = []
    run = merap.train(case, OUT / "run", on_update=lambda row: seconds.append(row.seconds))
    print(
        f"   {len(run.names)} tasks, {len(seconds)} updates, all but the first in {sum(seconds[1:]):.1f} s."
    )

    covered = case.combination("b_blocked.speed_high.g3")
    print(f"4. Met online, covered by a model: {covered.name}. Gradient steps from the meta policy:")
    _table(merap.adapt(run, covered, strategy="gradient", steps=5, seeds=SEEDS))

    system = declared(case.system("met"))
    print("5. Met online, not covered: location A is blocked, which no model foresaw; the goal is G3.")
    print("   Gradient steps alone (the meta policy goes through A and never sees another way pay):")
    by_gradient = merap.adapt(run, system, strategy="gradient", steps=5, seeds=SEEDS)
    _table(by_gradient)
    print("   A belief over the models, with mass kept for what they leave out:")
    by_belief = merap.adapt(run, system, strategy="belief", steps=5, seeds=SEEDS)
    _table(by_belief)

    horizon = system.objective.horizon
    before = most_likely_path(by_gradient.model, system, by_gradient.before, horizon, label="before")
    after = most_likely_path(by_belief.model, system, by_belief.after, horizon, label="after")
    for path in (before, after):
        print(f"   {path.label:6}  {path.text}")

    curves = {
        found.strategy: [[row.expected_return for row in one.curve] for one in found.runs]
        for found in (by_gradient, by_belief)
    }
    reachable = by_belief.reachable
    title = "Running example: A is blocked"
    written = [
        *save_figure(draw_before_after(system, before, after, title=title), OUT / "map"),
        *save_figure(draw_adaptation(curves, reachable.optimum, reachable.worst, title), OUT / "curve"),
    ]
    print("6. Drawn:", ", ".join(str(path.relative_to(ROOT)) for path in written))
    print(f"Done in {time.monotonic() - begin:.0f} s.")


def _table(found: Adaptation) -> None:
    """Return the mean expected return after each policy update, against the optimum."""
    print("   update   real episodes   expected return   best possible")
    for rows in zip(*(one.curve for one in found.runs), strict=True):
        mean = sum(row.expected_return for row in rows) / len(rows)
        print(f"   {rows[0].step:6}   {rows[0].episodes:13}   {mean:15.2f}   {found.reachable.optimum:13.2f}")


if __name__ == "__main__":
    with interruptible(last=True):
        main()
