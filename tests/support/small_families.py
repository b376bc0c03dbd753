"""Small families that are PRISM text."""

from __future__ import annotations

# A lamp that is lit at a place that the walker does not know.
LAMPS = """\
mdp
const int prize;
const double stick;
module walker
  place : [0..3] init 0;
  [left] place > 0 -> 1 - stick : (place' = place - 1) + stick : true;
  [right] place < 3 -> 1 - stick : (place' = place + 1) + stick : true;
  [look] true -> true;
endmodule
module lamp
  lit : bool init false;
  [look] place = prize -> (lit' = true);
  [look] place != prize -> true;
endmodule
rewards "steps"
  true : 1;
endrewards
"""
LAMPS_CASE = """\
case: lamps
program: {file: lamps.prism}
environment: {parameters: {prize: {int: [0, 3]}}, configurations: {near: {prize: 0}, next: {prize: 1}}}
capability:
  parameters: {stick: {probability: [0, 1]}}
  configurations: {smooth: {stick: 0.1}, sticky: {stick: 0.5}}
objective: {goal: lit, ends_in: lit, reward: steps, sign: -1, horizon: 20}
online: {met: {environment: {prize: 3}, capability: {stick: 0.3}}}
"""

# A cart on a rail, and a counter of its pushes that the user has.
RAIL = """\
mdp
const int far;
const double grip;
module cart
  place : [0..far] init 0;
  [push] place < far -> grip : (place' = place + 1) + 1 - grip : true;
  [pull] place > 0 -> (place' = place - 1);
endmodule
module tally
  pushes : [0..3] init 0;
  done : bool init false;
  [push] true -> (pushes' = min(pushes + 1, 3));
endmodule
label "there" = place = far;
rewards "effort"
  [push] true : 1;
endrewards
"""
RAIL_CASE = """\
case: rail
program: {file: rail.prism, owner: {objective: [tally]}}
environment:
  parameters: {far: {int: [1, 9]}}
  configurations: {short: {far: 2}, long: {far: 4}}
capability:
  parameters: {grip: {probability: [0, 1]}}
  configurations: {firm: {grip: 0.9}}
objective: {goal: '"there"', ends_in: '"there"', reward: effort, sign: -1, horizon: 30}
online: {met: {environment: {far: 7}, capability: {grip: 0.8}}}
"""
