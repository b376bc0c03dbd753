"""A small Markov decision process as PRISM text."""

from __future__ import annotations

# A walk of three steps to x = 3 that succeeds with 1/2 each, and what it costs.
WALK = """mdp
module walk
  x : [0..3] init 0;
  [go] x<3 -> 1/2 : (x'=x+1) + 1/2 : true;
  [rest] x<3 -> true;
  [end] x=3 -> true;
endmodule
label "goal" = x=3;
rewards "objective" [go] true : -1/2; [end] true : 3; endrewards
rewards "steps" x<3 : 1; endrewards
"""
