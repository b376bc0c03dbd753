"""Cases whose concerns read each other, and an objective that uses all that one can say."""

# Every concern reads the others: `rate` is a parameter of two of them.
PUMP = """\
case: pump
discount: 1
space: {locations: {here: [0, 0]}, edges: []}
environment:
  parameters: {rate: {probability: [0, 1]}, shade: {values: [dark, light]}}
  processes:
    level:
      range: [0, 3]
      initial: size
      changes:
        - {action: drain, set: "max(level - 1, 0)"}
        - set: [{value: "min(level + 1, size)", probability: rate}, {otherwise: level}]
  configurations:
    dry: {rate: 0.25, shade: dark}
    wet: {rate: 0.5, shade: light}
capability:
  parameters: {rate: {probability: [0, 1]}, size: {int: [1, 3]}}
  actions:
    rest: {stay: 1}
    drain: {stay: 1, requires: "shade = light & level > 0"}
  processes:
    wear:
      values: [new, worn, broken]
      initial: new
      changes:
        - where: "wear = new"
          set: [{value: worn, probability: "rate * environment.rate"}, {otherwise: "wear"}]
  configurations:
    small: {rate: 0.5, size: 1}
    large: {rate: 1, size: 3}
objective:
  parameters: {price: {real: [0, 9]}}
  start: here
  horizon: 4
  rewards:
    - {where: "wear = worn", value: "-price * size"}
    - {value: "level * environment.rate"}
  configurations: {cheap: {price: 2}}
"""

# Labels, a monitor, conditions on what a step leads to, start and horizon by configuration.
COURIER = """\
case: courier
space:
  grid: {rows: 2, cols: 3, moves: {left: [0, -1], right: [0, 1], up: [-1, 0], down: [1, 0]}}
environment:
  parameters: {shop: location, rain: {values: [dry, wet]}}
  configurations:
    near: {shop: [0, 1], rain: dry}
    far: {shop: [1, 2], rain: wet}
capability:
  actions:
    rest: {}
    left: {move: left}
    right: {move: right, probability: "rain = wet ? 0.5 : 1"}
    up: {move: up}
    down: {move: down, requires: "!(at(shop) & rain = wet)"}
objective:
  parameters: {home: location, from_where: location, moments: {int: [3, 9]}, price: {real: [0, 5]}}
  start: from_where
  horizon: moments
  labels:
    back: at(home)
    loaded: bag = full
    over: '"back" & "loaded"'
  goal: '"over"'
  ends_in: '"goal"'
  unsafe: 'at([[0, 1], [1, 1]]) & !"loaded" & rain = wet'
  processes:
    bag:
      values: [empty, full]
      initial: empty
      changes:
        - {where: "at'(shop) & moved", set: full}
  rewards:
    - {to: {at: home, bag: full}, value: 10}
    - {to: {bag: full}, where: bag = empty, value: 2}
    - {at: shop, value: "-3 * row - col"}
    - {at: {rows: [1, 1], cols: [0, 2]}, value: -2}
    - {to: {at: {rows: [0, 0], cols: [0, 1]}}, action: [left, rest], value: "col' - 4"}
    - {value: "-price"}
  configurations:
    patient: {home: [0, 0], from_where: [0, 0], moments: 9, price: 1}
    hasty: {home: [1, 0], from_where: [0, 2], moments: 4, price: 2.5}
online:
  met:
    environment: {shop: [1, 1], rain: wet}
    objective: {home: [0, 2], from_where: [1, 0], moments: 5, price: 0.5}
"""
