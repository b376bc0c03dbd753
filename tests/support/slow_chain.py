"""A chain that mixes slowly (Haddad and Monmege 2018, section 1), as PRISM text and as a case file.

From the middle of s0..s2n every inner state goes on outwards or back to the middle, with 1/2
each. Either end is reached with 1/2, after 3 * 2^(n-1) - 2 steps in the mean: e(d) = 1 + (e(d+1) +
e(0)) / 2 at distance d from the middle, e(0) = 1 + e(1), e(n) = 0.
"""

from __future__ import annotations


def expected_steps(n: int) -> int:
    return 3 * (1 << (n - 1)) - 2


def slow_chain(n: int, kind: str = "mdp") -> str:
    return f"""{kind}
module chain
  s : [0..{2 * n}] init {n};
  [go] s>0 & s<{n} -> 1/2 : (s'=s-1) + 1/2 : (s'={n});
  [go] s>{n} & s<{2 * n} -> 1/2 : (s'=s+1) + 1/2 : (s'={n});
  [go] s={n} -> 1/2 : (s'=s-1) + 1/2 : (s'=s+1);
  [end] s=0 | s={2 * n} -> true;
endmodule
label "goal" = s={2 * n};
label "out" = s=0 | s={2 * n};
rewards "steps" s>0 & s<{2 * n} : 1; endrewards
"""


def slow_case(n: int, properties: str) -> str:
    """Return a case file; `properties` are lines of YAML, `name: 'property'`."""
    locations = "".join(f"    s{i}: [{i}, 0]\n" for i in range(2 * n + 1))
    left = "".join(f"    - [s{i}, s{i - 1}, out]\n    - [s{i}, s{n}, home]\n" for i in range(1, n))
    right = "".join(f"    - [s{i}, s{i + 1}, out]\n    - [s{i}, s{n}, home]\n" for i in range(n + 1, 2 * n))
    return f"""case: slow
discount: 1
space:
  locations:
{locations}  edges:
{left}{right}    - [s{n}, s{n - 1}, out]
    - [s{n}, s{n + 1}, home]
    - [s0, s0, out]
environment:
  configurations: {{e: {{}}}}
capability:
  actions:
    go: {{outcomes: [{{move: out, probability: 1/2}}, {{move: home, probability: 1/2}}]}}
  configurations: {{c: {{}}}}
objective:
  parameters: {{goal: location}}
  start: s{n}
  horizon: 10
  rewards: [{{to: goal, value: 1}}]
  ends_in: {{at: goal}}
  properties:
{properties}
  configurations: {{o: {{goal: s{2 * n}}}}}
online:
  met: {{environment: e, capability: c, objective: o}}
"""
