"""A small model with open constants, deadlocks and commands without action, and its values by hand."""

from __future__ import annotations

# From 0 up to N, each step succeeds with p; at N nothing is left to do. `wait` gives the MDP a choice.
CLIMB = """mdp
const int N;
const double p;
formula high = x>=2;
module climb
  x : [0..N] init 0;
  [] x<N -> p : (x'=x+1) + 1-p : true;
  [wait] x<N -> (x'=x);
  [wait] x=1 -> (x'=0);
endmodule
label "top" = x=N;
rewards [] x<N : 1; endrewards
rewards "double" x<N : 2; endrewards
"""
