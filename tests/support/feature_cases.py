"""Small case files, each about one thing that the case language can say, for all routes to a model."""

FEATURES = {
    "sums of decimals in every concern": """\
case: sums
space: {locations: {a: [0, 0], b: [1, 0]}, edges: [[a, b, go], [b, a, back]]}
environment:
  processes:
    x: {range: [0, 1], initial: 0, changes: [{set: "1 - x"}]}
    y:
      type: bool
      initial: false
      changes: [{set: [{value: true, probability: "0.9 + 0.1 * x"}, {otherwise: false}]}]
    z:
      range: [0, 2]
      initial: 0
      changes:
        - set:
            - {value: 0, probability: "0.9 + 0.1 * x"}
            - {value: 1, probability: "0.1 - 0.1 * x"}
            - {otherwise: 2}
capability:
  actions:
    go: {move: go, probability: "0.9 + 0.1 * x"}
    back: {move: back, probability: "1 - 0.9 - 0.1 * x"}
    rest: {requires: "0.9 + 0.1 * x = 1"}
  processes:
    w:
      type: bool
      initial: [{value: true, probability: 0.3}, {otherwise: false}]
      changes: [{action: go, set: [{value: "!w", probability: "0.9 + 0.1 * x"}, {otherwise: w}]}]
objective:
  start: a
  horizon: 9
  processes:
    seen: {type: bool, initial: false, changes: [{where: "0.9 + 0.1 * x' = 1", set: true}]}
  labels: {all: "0.9 + 0.1 * x = 1"}
  rewards: [{where: "0.9 + 0.1 * x' = 1 & seen'", value: "0.9 + 0.1 * x"}, {value: -0.1}]
  unsafe: '0.9 + 0.1 * x = 1 & z = 2'
  ends_in: '"all" & w & y & at(b)'
""",
    "thresholds of decimals": """\
case: thresholds
environment:
  processes:
    x:
      range: [0, 5]
      initial: 0
      changes: [{where: "0.1 * x <= 0.3", set: "x + 1"}, {where: "x / 10 > 0.4", set: "x"}, {set: 5}]
capability:
  actions: {slow: {requires: "0.1 * x <= 0.3"}, fast: {requires: "0.1 * x >= 0.3"}, any_time: {}}
  processes:
    n: {range: [0, 3], initial: 0, changes: [{action: slow, where: "0.1 * x = 0.3 & n < 3", set: "n + 1"}]}
objective:
  horizon: 9
  labels: {low: "0.1 * x <= 0.3", just: "0.1 * x >= 0.3 & 0.3 >= 0.1 * x"}
  goal: '"just"'
  rewards: [{where: "0.1 * x <= 0.3 & 0.1 * x' > 0.3", value: 5}, {where: '"low"', value: "0.1 * x"}]
  unsafe: "!(0.1 * x <= 0.3) & n = 0"
  ends_in: "0.1 * x > 0.4 & n > 0"
""",
    "doors, locked and blown shut": """\
case: doors
space:
  locations: {a: [0, 0], b: [1, 0], c: [2, 0]}
  edges: [[a, b, right], [b, c, right], [b, a, left], [c, b, left], [a, c, around]]
  doors:
    first:
      between: [a, b]
      open: true
      changes: [{where: "first & moved", set: [{value: false, probability: draught}, {otherwise: true}]}]
    second: {between: [c, b], open: false}
environment:
  parameters: {draught: {probability: [0, 1]}, locked: doors}
  configurations:
    free: {draught: 0.25, locked: []}
    shut: {draught: 0.25, locked: [second]}
    open_but_locked: {draught: 0.5, locked: [first]}
capability:
  actions:
    right: {move: right, probability: 0.9}
    left: {move: left, on_blocked: disable}
    around:
      outcomes: [{move: around, probability: 0.5, sets: {first: false}}, {move: stay, probability: 0.5}]
    push: {sets: {second: {where: "at(b) | at(c)", set: true}, first: {where: "!first", set: true}}}
objective:
  parameters: {goal: location}
  start: a
  horizon: 9
  rewards: [{where: "second' & !second", value: 1}, {to: c, value: 2}]
  ends_in: {at: goal}
  configurations: {c: {goal: c}, b: {goal: b}}
""",
    "linked processes": """\
case: linked
space: {grid: {rows: 2, cols: 3, moves: {right: [0, 1], down: [1, 0], left: [0, -1]}}}
environment:
  parameters: {p: {probability: [0, 1]}}
  processes:
    wet:
      type: bool
      initial: false
      changes: [{where: "at'([1, 2])", set: [{value: true, probability: p}, {otherwise: false}]}]
    cold: {range: [0, 2], initial: 0, changes: [{where: "wet' & cold < 2", set: "cold + 1"}]}
    other:
      type: bool
      initial: false
      changes: [{set: [{value: true, probability: 0.5}, {otherwise: other}]}]
  configurations: {some: {p: 0.4}, sure: {p: 1}}
capability:
  actions:
    right: {move: right, probability: 0.7, otherwise: down}
    left: {move: left, probability: "row = 1 ? 0.5 : 1"}
    down: {move: down}
  processes:
    tired:
      range: [0, 3]
      initial: 0
      changes:
        - {where: "moved & cold' > cold", set: "min(tired + 2, 3)"}
        - {where: "!moved", set: "max(tired - 1, 0)"}
        - {where: "row' > row & tired < 3", set: [{value: "tired + 1", probability: 0.5}, {otherwise: tired}]}
objective:
  start: [0, 0]
  horizon: 9
  processes:
    worst: {range: [0, 3], initial: 0, changes: [{where: "tired' > worst", set: "worst + 1"}]}
    twice: {type: bool, initial: false, changes: [{where: "worst' = 3 & col' = 2", set: true}]}
  goal: twice
  rewards: [{where: "worst' > worst", value: -2}, {where: "col' > col", value: "col'"}]
  ends_in: twice
  unsafe: {at: {rows: [1, 1], cols: [1, 2]}, where: wet}
""",
    "an outcome sets what its action and the owner change too": """\
case: layered
space: {locations: {a: [0, 0], b: [1, 0]}, edges: [[a, b, go], [b, a, go]]}
environment:
  processes:
    lamp: {range: [0, 4], initial: 0, changes: [{set: "lamp > 3 ? 0 : lamp + 1"}]}
capability:
  actions:
    go:
      sets: {lamp: {where: lamp < 2, set: 3}}
      outcomes:
        - {move: go, probability: 0.5, sets: {lamp: {where: lamp = 0, set: 4}}}
        - {move: stay, probability: 0.3}
        - {move: stay, probability: 0.2, sets: {lamp: {where: moved, set: 1}}}
    wait: {}
objective: {start: a, horizon: 4, rewards: [{action: go, value: lamp' - lamp}]}
""",
    "sets, drawn with an outcome or apart from it": """\
case: sets
space: {locations: {a: [0, 0], b: [1, 0]}, edges: [[a, b, go], [b, a, go]]}
environment:
  processes:
    lamp: {type: bool, initial: true, changes: [{set: [{value: false, probability: 0.1}, {otherwise: lamp}]}]}
    fuel:
      range: [0, 2]
      initial: 2
      changes: [{where: "fuel > 0", set: [{value: "fuel - 1", probability: 0.5}, {otherwise: fuel}]}]
capability:
  actions:
    go:
      outcomes:
        - {move: go, probability: 0.6, sets: {lamp: true, fuel: {where: "at'(b)", set: 2}}}
        - {move: stay, probability: 0.4}
    flip: {sets: {lamp: {where: "fuel > 0", set: "!lamp"}}}
    fill: {sets: {fuel: {where: "at(a)", set: [{value: 2, probability: 0.8}, {otherwise: 0}]}, kept: a_value}}
  processes:
    kept: {values: [none, a_value], initial: none, changes: [{action: go, where: moved, set: none}]}
objective:
  start: {a: 0.75, b: 0.25}
  horizon: 9
  rewards: [{action: fill, where: "lamp' & kept = none", value: 3}, {to: {at: b, kept: a_value}, value: 1}]
  unsafe: "fuel = 0 & !lamp"
""",
    "modes, attributes, ends after a step": """\
case: modes
discount: 0.9
space:
  locations: {a: [0, 0], b: [1, 0], c: [2, 0]}
  edges: [[a, b, go], [b, c, go], [b, a, back]]
  attributes: {slope: {type: real, default: 0.1, values: {b: 0.3}}, light: {range: [0, 3], default: 2}}
environment:
  parameters: {dark: locations, level: {int: [0, 3]}, blocked: locations}
  attributes: {light: [{at: dark, value: level}]}
  configurations:
    day: {dark: [], level: 0, blocked: []}
    night: {dark: [b, c], level: 1, blocked: [c]}
capability:
  parameters: {grip: {probability: [0, 1]}}
  actions:
    go: {move: go, probability: "slope' >= 0.3 ? grip * light / 2 : grip", on_blocked: disable}
    back: {move: back, requires: "light > 1 | heat = 0"}
    stop: {stay: 1}
  innate:
    name: scan
    modes: [idle, scanning, scanned]
    entry: scanning
    initial: idle
    terminal: [idle, scanned]
    actions: {measure: {scanning: {scanned: grip, scanning: 1 - grip}}}
  processes:
    heat:
      range: [0, 2]
      initial: 0
      changes:
        - {action: [measure, start_scan], where: "heat < 2", set: "heat + 1"}
        - {where: "mode' = scanned", set: [{value: 0, probability: 0.5}, {otherwise: heat}]}
  configurations: {new: {grip: 0.9}, old: {grip: 0.5}}
objective:
  parameters: {goal: location}
  start: a
  horizon: 9
  rewards:
    - {at: goal, mode: scanned, action: stop, value: 10}
    - {to_mode: scanned, value: "light * slope"}
    - {value: -1}
  ends_after: {at: goal, action: stop, where: "heat < 2"}
  ends_in: {at: b, mode: scanned, where: "heat = 2"}
  unsafe: "heat = 2 & mode != scanned => light < 2"
  configurations: {b: {goal: b}, a: {goal: a}}
""",
    "no space, several variables in one process": """\
case: queue
environment:
  parameters: {up: {probability: [0, 1]}}
  processes:
    weather:
      variables: {rain: {type: bool}, wind: {range: [-1, 1]}}
      initial:
        - {value: {rain: true, wind: 1}, probability: 0.25}
        - {otherwise: {rain: false, wind: 0}}
      changes:
        - where: "wind < 1"
          set:
            - {value: {wind: "wind + 1"}, probability: up}
            - {value: {rain: "!rain", wind: -1}, probability: "(1 - up) / 3"}
            - {otherwise: {}}
        - {set: {wind: "mod(wind + 2, 3) - 1", rain: "wind = 1"}}
  configurations: {low: {up: 0.1}, high: {up: 1}}
capability:
  parameters: {up: {probability: [0, 1]}}
  actions: {work: {requires: "environment.up > capability.up | jobs > 0"}, rest: {}}
  processes:
    jobs:
      range: [0, 3]
      initial: 1
      changes:
        - {action: work, where: "rain <=> wind >= 0", set: "max(0, jobs - 1)"}
        - {where: "jobs < 3", set: [{value: "jobs + 1", probability: up}, {otherwise: jobs}]}
  configurations: {weak: {up: 0.5}, none: {up: 0}}
objective:
  parameters: {steps_left: int, dear: {values: [work, rest]}, price: {real: [0, 9]}}
  horizon: steps_left
  rewards:
    - {action: work, where: "jobs' < jobs", value: "2 - floor(price / 2) + ceil(-0.5 * jobs)"}
    - {where: "dear = rest", value: "-price * pow(2, jobs)"}
  ends_in: "jobs = 0 & rain"
  configurations:
    short: {steps_left: 4, dear: work, price: 1.5}
    long: {steps_left: 7, dear: rest, price: 2}
""",
    "monitors that read the objective": """\
case: errands
space: {grid: {rows: 2, cols: 2, moves: {right: [0, 1], down: [1, 0], left: [0, -1], up: [-1, 0]}}}
environment: {}
capability:
  actions: {right: {move: right}, down: {move: down}, left: {move: left}, up: {move: up}}
objective:
  parameters: {home: location, first: location, shops: locations, limit: {int: [0, 4]}}
  start: home
  horizon: 9
  processes:
    leg:
      values: [out, back, over]
      initial: out
      changes:
        - {where: "leg = out & at'(first)", set: back}
        - {where: "leg = back & at'(home)", set: over}
    visits: {range: [0, 4], initial: 0, changes: [{where: "at'(shops) & visits < limit", set: "visits + 1"}]}
    late: {type: bool, initial: false, changes: [{where: "leg' = back & visits' >= limit", set: true}]}
  goal: "leg = over"
  labels: {shopped: "visits > 0 | at(shops)", ready: '"goal" & !late'}
  rewards: [{to: {leg: over}, value: 9}, {where: '"shopped" & leg = back', value: 1}, {value: -1}]
  ends_in: '"ready" | late & leg = over'
  unsafe: "late & at([[0, 1], [1, 0]])"
  configurations:
    near: {home: [0, 0], first: [0, 1], shops: [[0, 1], [1, 0]], limit: 2}
    far: {home: [1, 1], first: [0, 0], shops: [[0, 1]], limit: 1}
""",
}
