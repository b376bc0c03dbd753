"""Small case files that tests of several modules share, and helpers to write them."""

from __future__ import annotations

from pathlib import Path

# A 3 x 3 grid: one concern of each kind generated, everything deterministic.
GRID = """\
case: small_grid
discount: 0.9
space:
  grid: {rows: 3, cols: 3, moves: {up: [-1, 0], down: [1, 0], left: [0, -1], right: [0, 1]}}
environment:
  parameters: {blocked: locations}
  configurations:
    generate: {blocked: {choose: 2, from: {rows: [0, 1], cols: [0, 2]}, except: [[0, 0]]}}
    require_reachable: true
capability:
  parameters: {no_entry: locations}
  actions:
    stop: {stay: 1}
    up: {move: up}
    down: {move: down}
    left: {move: left}
    right: {move: right, on_blocked: disable}
  configurations: {generate: {no_entry: {choose: 1, from: [[2, 0], [2, 1]]}}}
objective:
  parameters: {goal: location}
  start: [0, 0]
  horizon: 6
  rewards:
    - {at: goal, action: stop, value: 10}
    - {value: -0.5}
  ends_after: {at: goal}
  configurations: {generate: {goal: {from: [[2, 2], [0, 2]]}}}
online:
  met: {environment: {blocked: [[1, 1]]}, capability: no_entry_r2c0, objective: {goal: [2, 2]}}
  covered:
    {environment: blocked_r0c1_r1c1, capability: {no_entry: [[2, 1]]}, objective: {goal: [2, 2]}, horizon: 6}
"""

# A graph of four locations with everything a case can have.
GRAPH = """\
case: small_graph
discount: 1
space:
  locations:
    S: [0, 0]
    A: [1, 0]
    B: [1, 1]
    G: [2, 0]
  edges:
    - [S, A, east]
    - [A, G, east]
    - [S, B, north]
    - [B, G, south]
    - [A, S, west]
    - [G, A, west]
  attributes:
    light: {range: [0, 3], default: 2, values: {B: 0}}
    slippery: {type: bool, values: [{at: [A, B], value: true}]}
    slope: {range: [0.0, 1.0], default: 0.25}
  detectors:
    lidar: {of: blocked, range: 1, accuracy: 0.95}
environment:
  parameters: {blocked: locations, blocked_edges: edges, lamp: int}
  attributes: {light: {A: lamp}}
  configurations:
    open: {blocked: [], blocked_edges: [], lamp: 3}
    dim: {blocked: [B], blocked_edges: [[A, S]], lamp: 1}
capability:
  parameters: {grip: probability, has_scanner: bool, strong: bool}
  actions:
    stop: {stay: 1}
    east: {move: east, probability: "slippery' ? grip * 0.5 : grip"}
    north: {move: north, probability: grip, otherwise: east}
    south: {outcomes: [{move: south, probability: grip}, {move: stay, probability: 1 - grip}]}
    west: {move: west, requires: strong}
  innate:
    name: scan
    modes: [idle, scanning, scanned]
    entry: scanning
    terminal: [idle, scanned]
    actions: {measure: {scanning: {scanned: grip, scanning: 1 - grip}}}
    requires: has_scanner
  configurations:
    slow: {grip: 0.9, has_scanner: true, strong: true}
    fast: {grip: 0.8, has_scanner: false, strong: false}
objective:
  parameters: {goal: locations, bonus: real}
  start: {S: 0.75, A: 0.25}
  horizon: 12
  rewards:
    - {at: goal, action: stop, mode: [scanned, idle], value: 10 + bonus}
    - {to: [B], where: "light' = 0 & mode' = mode", value: -3}
    - {action: west, to_mode: idle, value: "light - 4"}
    - {value: -1}
  ends_in: {at: goal, mode: scanned, where: light > 0}
  ends_after: {at: goal, action: stop}
  unsafe: light = 0 & mode != scanning
  properties: {soon: 'Pmax>=0.5 [F<=12 "goal"]'}
  configurations:
    g: {goal: [G], bonus: 0.5}
    ab: {goal: [A, B], bonus: -1}
online:
  met:
    environment: {blocked: [A], blocked_edges: [], lamp: 0}
    capability: slow
    objective: g
    start: S
    horizon: 20
"""


def write_case(folder: Path, text: str, name: str = "case.yaml") -> Path:
    """Return the path of a file in `folder` with that text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def replaced(text: str, old: str, new: str) -> str:
    """`text` with its one `old` replaced."""
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
    return text.replace(old, new)
