"""Wrong case files, made from the examples by one replacement each.

A row is (text to replace, replacement, text that ends on the line that must be named, key, part
of the message).
"""

# ruff: noqa: E501
# fmt: off

from __future__ import annotations

Row = tuple[str, str, str, str, str]

KEYS_AND_TYPES: list[Row] = [
    ("  horizon: 12", "  horzion: 12", "horzion", "objective.horzion", "unknown key 'horzion'; did you mean 'horizon'?"),
    ("  horizon: 12\n", "", "objective:", "objective", "key 'horizon' is missing"),
    ("horizon: 12", "horizon: soon", "horizon: soon", "objective.horizon", "expected a number, or a parameter of type int; got 'soon'"),
    ("horizon: 12", "horizon: 1.5", "horizon: 1.5", "objective.horizon", "expected a whole number from 1 to 1000000, or a parameter, got 1.5"),
    ("horizon: 12", "horizon: 0", "horizon: 0", "objective.horizon", "or a parameter, got 0"),
    ("discount: 1\n", "discount: 1.5\n", "discount", "discount", "at most 1.0, got 1.5"),
    ("discount: 1\n", "discount: 0\n", "discount", "discount", "a number above 0.0, got 0"),
    ("discount: 1\n", "discount: .nan\n", "discount", "", ".nan is not a number"),
    ("discount: 1\n", "discount: true\n", "discount", "discount", "expected a number, got true"),
    ("discount: 1\n", "discount:\n", "discount", "discount", "expected a number, got nothing"),
    ("case: small_graph", "case: [1]", "case:", "case", "expected text, got [1]"),
    ("    S: [0, 0]", "    S: [0]", "S: [0]", "space.locations.S", "too few entries, got [0]"),
    ("    - [S, A, east]", "    - [S, A]", "[S, A]", "space.edges[0]", "too few entries, got ['S', 'A']"),
    ("grip: probability", "grip: chance", "grip: chance", "capability.parameters.grip", "got 'chance'"),
    ("    stop: {stay: 1}", "    stop: {stay: 2}", "stop:", "capability.actions.stop.stay", "expected 1"),
    ("    stop: {stay: 1}", "    stop: {stay: 1, move: east}", "stop:", "capability.actions.stop", "give one of stay, move and outcomes, not stay and move"),
    ("{stay: 1}", "{stay: 1, probability: 1}", "stop:", "capability.actions.stop.probability", "goes with move"),
    ("north, probability: grip, otherwise: east", "north, on_blocked: wait", "wait", "on_blocked", "'stay' or 'disable'"),
    ("  unsafe: light = 0 & mode != scanning", "  unsafe: [light]", "unsafe", "objective.unsafe", "expected a mapping with keys of at, mode"),
    ("value: 10 + bonus", "value: true", "action: stop, mode", "objective.rewards[0].value", "a number or an expression"),
    ("- {value: -1}", "- {value: -1, when: 3}", "when", "objective.rewards[3].when", "unknown key 'when'"),
    ("    lidar: {of: blocked,", "    lidar: {of: heat,", "lidar", "space.detectors.lidar.of", "can't see 'heat'"),
    ("accuracy: 0.95", "accuracy: 1.95", "lidar", "space.detectors.lidar.accuracy", "at most 1.0, got 1.95"),
]

SPACE: list[Row] = [
    ("- [A, G, east]", "- [A, X, east]", "X, east", "space.edges[1][1]", "an edge to nowhere: unknown location 'X'"),
    ("- [A, G, east]", "- [Y, G, east]", "Y, G", "space.edges[1][0]", "unknown location 'Y'"),
    ("- [G, A, west]", "- [S, G, east]", "S, G", "space.edges[5]", "two edges from S with the label 'east'"),
    ("- [G, A, west]", "- [G, A, stay]", "G, A, stay", "space.edges[5][2]", "illegal name 'stay' of an edge label"),
    ("    B: [1, 1]", "    B-1: [1, 1]", "B-1", "space.locations.B-1", "illegal name 'B-1' of a location"),
    ("    B: [1, 1]", "    A: [1, 1]", "A: [1, 1]", "", "the key 'A' stands twice"),
    ("values: {B: 0}", "values: {B: 9}", "B: 9", "space.attributes.light.values.B", "a whole number from 0 to 3, got 9"),
    ("values: {B: 0}", "values: {Q: 0}", "Q: 0", "space.attributes.light.values.Q", "unknown location 'Q'"),
    ("value: true}]", "value: 1}]", "slippery", "slippery.values[0]", "expected true or false, got 1"),
    ("default: 2, ", "", "light", "space.attributes.light", "key 'default' is missing: location S has no value"),
    ("    slippery:", "    floor:", "floor", "space.attributes.floor", "illegal name 'floor' of an attribute"),
    ("    slippery:", "    idle:", "idle", "space.attributes.idle", "duplicate name 'idle'"),
]

NAMES: list[Row] = [
    ("    north: {move", "    start_scan: {move", "name: scan", "capability.innate.name", "duplicate name 'start_scan'"),
    ("    north: {move", "    end: {move", "end: {", "capability.actions.end", "it is the action of complete states"),
    ("    north: {move", "    n-e: {move", "n-e: {", "capability.actions.n-e", "illegal name 'n-e' of an external action"),
    ("    north: {move", "    measure: {move", "measure: {sca", "innate.actions.measure", "duplicate name 'measure'"),
    ("    name: scan", "    name: 1x", "name: 1x", "capability.innate.name", "illegal name '1x' of the automaton"),
    ("    name: scan", "    name: east", "name: east", "capability.innate.name", "duplicate name 'east'"),
    ("modes: [idle, scanning, scanned]", "modes: [idle, scanning, scanned, idle]", "modes", "innate.modes[3]", "twice"),
    ("grip: probability", "light: probability", "light: prob", "capability.parameters.light", "an attribute already"),
    ("grip: probability", "A: probability", "A: prob", "capability.parameters.A", "a location already"),
    ("goal: locations", "goal: real", "goal: real", "objective.parameters.goal", "of type location or locations, not real"),
    ("    slow:", "    slow-1:", "slow-1", "capability.configurations.slow-1", "illegal name 'slow-1'"),
    ("    fast:", "    slow:", "slow: {grip: 0.8", "", "the key 'slow' stands twice"),
    ("  met:\n    env", "  g:\n    env", "online:\n", "online.g", "duplicate name 'g'"),
    ("{soon:", "{too soon:", "too soon", "objective.properties.too soon", "illegal name 'too soon' of a property"),
]

EXPRESSIONS: list[Row] = [
    ("unsafe: light = 0 &", "unsafe: light = = 0 &", "unsafe", "objective.unsafe", "syntax error at column 9"),
    ("unsafe: light = 0 &", "unsafe: lihgt = 0 &", "unsafe", "objective.unsafe", "unknown variable 'lihgt' at column 1; did you mean 'light'?"),
    ("unsafe: light = 0 &", "unsafe: light' = 0 &", "unsafe", "objective.unsafe", "what light becomes is not known"),
    ("unsafe: light = 0 &", "unsafe: light + 1 &", "unsafe", "objective.unsafe", "needs a bool where there is a number"),
    ("unsafe: light = 0 & mode != scanning", "unsafe: light", "unsafe", "objective.unsafe", "is a number, expected a bool"),
    ("value: 10 + bonus", "value: 10 + grips", "10 + grips", "objective.rewards[0].value", "unknown variable 'grips' at column 6; did you mean 'grip'"),
    ("value: 10 + bonus", "value: 10 / (bonus - bonus)", "10 /", "objective.rewards[0]", "division by zero (objective g)"),
    ("grip * 0.5 : grip", "grip * 0.5", "slippery'", "capability.actions.east.probability", "syntax error at column 23"),
    ("requires: strong}", "requires: lights > 0}", "requires", "west.requires", "unknown variable 'lights' at column 1; did you mean 'light'"),
    ("scanned: grip,", "scanned: grip * light,", "measure", "measure.scanning.scanned", "'light' at column 8 can't be read here: parameters alone"),
    ("mode: scanned, where", "mode: scaned, where", "scaned", "ends_in.mode", "unknown mode 'scaned'; did you mean 'scanned'"),
    ("action: stop}", "action: stopp}", "stopp", "ends_after.action", "unknown action 'stopp'; did you mean 'stop'?"),
    ("to: [B]", "to: [B, bonus]", "bonus]", "rewards[1].to", "'bonus' is of type real, it holds no locations"),
    ("{at: goal, action: stop}", "{at: gaol, action: stop}", "gaol", "ends_after.at", "unknown location 'gaol'"),
]

CAPABILITY: list[Row] = [
    ("{move: north,", "{move: nord,", "nord", "capability.actions.north.move", "unknown edge label 'nord'; did you mean 'north'"),
    ("otherwise: east", "otherwise: up", "otherwise: up", "capability.actions.north.otherwise", "unknown edge label 'up'"),
    ("slow: {grip: 0.9,", "slow: {grip: 1.9,", "1.9", "configurations.slow.grip", "a probability in [0, 1], got 1.9"),
    ("probability: grip, other", "probability: grip + 1, other", "north:", "capability.actions.north", "action north: an outcome has the probability 1.9, not in [0, 1], at location S in mode idle (environment open, capability slow)"),
    ("move: stay, probability: 1 - grip", "move: stay, probability: 0.2", "south:", "capability.actions.south", "action south: the probabilities sum to 1.1, not 1, at location S"),
    ("move: stay, probability: 1 - grip", 'move: stay, probability: "light = 0 ? 0 : 1 - grip"', "south:", "capability.actions.south", "the probabilities sum to 0.9, not 1, at location B in mode idle"),
    ("scanning: 1 - grip}", "scanning: 0.2}", "measure", "measure.scanning", "the probabilities of measure sum to 1.1, not 1 (capability slow)"),
    ("scanned: grip,", "scanned: grip - 1,", "measure", "measure.scanning.scanned", "probability -0.1 is not in [0, 1] (capability slow)"),
    ("entry: scanning", "entry: scaning", "entry", "capability.innate.entry", "unknown mode 'scaning'"),
    ("terminal: [idle, scanned]", "terminal: [idle, done]", "terminal", "capability.innate.terminal[1]", "unknown mode 'done'"),
    ("measure: {scanning: {", "measure: {scan: {", "measure", "actions.measure.scan", "unknown mode 'scan'"),
    ("slow: {grip: 0.9, ", "slow: {", "slow", "capability.configurations.slow", "the parameter 'grip' has no value"),
    ("slow: {grip: 0.9, ", "slow: {grip: 0.9, drag: 1, ", "drag", "slow.drag", "unknown parameter 'drag'"),
    ("strong: true}", "strong: 1}", "slow", "slow.strong", "expected true or false, got 1"),
    ("lamp: 3}", "lamp: 7}", "{light: {A: lamp}}", "environment.attributes.light.A", "from 0 to 3, got 7"),
    ("lamp: 3}", "lamp: 0.5}", "open:", "environment.configurations.open.lamp", "a whole number, got 0.5"),
    ("{light: {A: lamp}}", "{light: {A: lump}}", "lump", "environment.attributes.light.A", "unknown parameter 'lump'; did you mean 'lamp'?"),
    ("{light: {A: lamp}}", "{lihgt: {A: lamp}}", "lihgt", "environment.attributes.lihgt", "unknown attribute 'lihgt'"),
    ("blocked_edges: [[A, S]]", "blocked_edges: [[B, S]]", "dim:", "dim.blocked_edges", "there is no edge ['B', 'S']"),
]

STARTS: list[Row] = [
    ("start: {S: 0.75, A: 0.25}", "start: {S: 0.75, A: 0.5}", "start", "objective.start", "sums to 1.25, not 1"),
    ("start: {S: 0.75, A: 0.25}", "start: {S: 1.75}", "start", "objective.start.S", "a probability in [0, 1], got 1.75"),
    ("start: {S: 0.75, A: 0.25}", "start: Z", "start", "objective.start", "unknown location 'Z'"),
    ("start: {S: 0.75, A: 0.25}", "start: bonus", "start", "objective.start", "'bonus' is of type real, it holds no locations"),
    ("start: {S: 0.75, A: 0.25}", "start: [S, A]", "start", "objective.start", "expected a location, a mapping"),
    ("  start: {S: 0.75, A: 0.25}\n", "", "objective:", "objective", "key 'start' is missing"),
    ("dim: {blocked: [B]", "dim: {blocked: [B, A]", "dim", "environment.configurations.dim.blocked", "the start location A is blocked (environment dim)"),
    ("    start: S\n    horizon: 20\n", "    start: A\n", "  met:", "online.met", "the start location A is blocked"),
    ("    horizon: 20\n", "    reset: home\n", "home", "online.met.reset", "expected 'episodes', 'return_to_start' or 'none', got 'home'"),
    ("capability: slow\n", "capability: slwo\n", "slwo", "online.met.capability", "unknown configuration 'slwo' of capability; did you mean 'slow'"),
    ("    capability: slow\n", "", "  met:", "online.met", "key 'capability' is missing, and capability has 2 configurations"),
    ("lamp: 0}", "lamp: 0, lump: 1}", "lump", "online.met.environment.lump", "unknown parameter 'lump'"),
]

GENERATED: list[Row] = [
    ("except: [[0, 0]]", "except: [[0, 9]]", "except", "generate.blocked.except", "unknown location [0, 9]: rows are 0 to 2"),
    ("choose: 2,", "choose: 9,", "choose", "generate.blocked", "empty concern: 9 can't be chosen from 5 members"),
    ("choose: 2, ", "", "from: {rows", "generate.blocked", "key 'choose' is missing"),
    ("{goal: {from:", "{goal: {choose: 1, from:", "goal: {choose", "generate.goal.choose", "not for location"),
    ("rows: [0, 1], cols", "rows: [1, 0], cols", "rows: [1", "generate.blocked.from", "expected [first, last] as whole numbers with first <= last, got [1, 0]"),
    ("[[2, 0], [2, 1]]", "[[2, 0], [2, 0]]", "no_entry: {choose", "generate.no_entry.from", "r2c0 stands twice"),
    ("[[2, 0], [2, 1]]", "[[2, 0], [0, 0]]", "no_entry: {choose", "capability.configurations", "the start location r0c0 can't be entered (capability no_entry_r0c0)"),
    (", except: [[0, 0]]}}\n    require_reachable: true", "}}", "  parameters: {blocked: locations}\n", "environment.configurations", "the start location r0c0 is blocked (environment blocked_r0c0_r0c1)"),
    ("require_reachable: true", "sample: 100", "sample", "configurations.sample", "a sample of 100 is more than the 10 configurations"),
    ("[[2, 2], [0, 2]]}}}", "[[2, 2], [0, 2]]}}, require_reachable: true}", "require_reachable: true}", "objective.configurations.require_reachable", "belongs to the configurations of the environment"),
    ("choose: 2, from: {rows: [0, 1], cols: [0, 2]}, except: [[0, 0]]", "choose: 2, from: [[0, 1], [1, 0]]", "  parameters: {blocked: locations}\n", "environment.configurations", "empty concern: environment has no configuration"),
    ("grid: {rows: 3", "grid: {rows: 1000000", "  grid:", "space.grid.rows", "at most 1000, got 1000000"),
    ("right: [0, 1]}}", "right: [0, 0]}}", "  grid:", "space.grid.moves.right", "leads nowhere"),
    ("no_entry_r2c0, obj", "no_entry_r9c9, obj", "  met:", "online.met.capability", "unknown configuration 'no_entry_r9c9' of capability"),
    ("blocked_r0c1_r1c1,", "blocked_r0c1_r1c0,", "  covered:\n", "online.covered.environment", "unknown configuration 'blocked_r0c1_r1c0'"),
]

ON_THE_GRAPH = [*KEYS_AND_TYPES, *SPACE, *NAMES, *EXPRESSIONS, *CAPABILITY, *STARTS]
