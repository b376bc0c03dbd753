"""Measure the exploration of programs, and evidence about their parameters: scripts.bench program.

Storm builds the same texts in the same run; the ratio of the two is what to quote.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from merap.checker.prism_reading import read_prism
from merap.checker.storm import build_text
from merap.checker.storm_model import StormModel
from merap.mdp.model import Ints, TabularMDP
from merap.mdp.umb import read_umb
from merap.program.arrays import tabular
from merap.program.closing import closed
from merap.program.exploration import explore
from merap.program.form import Program
from scripts.bench.evidence import evidence_figures
from scripts.bench.growth import growth_figures
from scripts.bench.learning import report
from scripts.bench.tables import Json, timed

T = TypeVar("T")
SIDES, LENGTHS = (32, 100, 316, 1000), (1_000, 10_000, 100_000)

# a slippery grid: five actions, of which four slip to either side
GRID = """mdp
const int n = {size};
formula up = row>0 ? row-1 : row;      formula down = row<n-1 ? row+1 : row;
formula left = col>0 ? col-1 : col;    formula right = col<n-1 ? col+1 : col;
module grid
  row : [0..n-1] init 0;  col : [0..n-1] init 0;
  [up] true -> 8/10 : (row'=up) + 1/10 : (col'=left) + 1/10 : (col'=right);
  [down] true -> 8/10 : (row'=down) + 1/10 : (col'=left) + 1/10 : (col'=right);
  [left] true -> 8/10 : (col'=left) + 1/10 : (row'=up) + 1/10 : (row'=down);
  [right] true -> 8/10 : (col'=right) + 1/10 : (row'=up) + 1/10 : (row'=down);
  [stop] true -> true;
endmodule
label "goal" = row=n-1 & col=n-1;
rewards "objective" [stop] row=n-1 & col=n-1 : 10; [up] true : 1/2; endrewards
"""

# narrow and deep: every step leads on or back to the start
CHAIN = """mdp
const int n = {size};
module chain
  x : [0..n-1] init 0;
  [go] x<n-1 -> 1/2 : (x'=x+1) + 1/2 : (x'=0);
  [rest] x=n-1 -> true;
endmodule
rewards "objective" [rest] true : 1; endrewards
"""


def program(
    json_file: Json = None,
    repeats: Annotated[int, typer.Option(help="The fastest of these runs counts.")] = 3,
) -> None:
    """Explore grids, and chains by a list of states, side by side with Storm; take in evidence."""
    figures: dict[str, float] = {}
    for side in SIDES:
        figures |= _compared(GRID.format(size=side), f"grid_{side**2}", repeats, by_list=False)
    for length in LENGTHS:
        figures |= _compared(CHAIN.format(size=length), f"chain_{length}", repeats, by_list=True)
    report("program", figures | evidence_figures() | growth_figures(repeats), json_file)


def _compared(text: str, name: str, repeats: int, *, by_list: bool) -> dict[str, float]:
    """Seconds of one text by both routes, which take turns."""
    read = _read(text)
    ours, theirs = [], []
    for _ in range(repeats):
        taken, stored = timed(lambda: export_mapped(build_text(text, name)))
        theirs.append(taken)
        states = stored.valuations if by_list else None
        taken, found = timed(partial(_explored, read, states))
        ours.append(taken)
        assert found.num_branches == stored.num_branches
    return {
        f"{name}_seconds": min(ours),
        f"{name}_seconds_storm": min(theirs),
        f"{name}_over_storm": min(ours) / min(theirs),
    }


def _explored(read: Program, states: Ints | None) -> TabularMDP:
    return tabular(read, explore(read, states), reward="objective")


def _read(text: str) -> Program:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.prism"
        path.write_text(text, encoding="utf-8")
        return closed(read_prism(path).program, {})


def export_mapped(model: StormModel) -> TabularMDP:
    """Return Storm's model as arrays, by an archive that is mapped into memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.umb"
        model.export_umb(path)
        return read_umb(path)
