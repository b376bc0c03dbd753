"""A case with processes in every concern: a web service that follows its load, watched for idling."""

SERVICE = """\
case: service
discount: 0.98
space:
  locations: {here: [0, 0]}
  edges: []
environment:
  parameters: {up: probability, down: probability}
  processes:
    load:
      range: [0, 4]
      initial: 1
      changes:
        - set:
            - {value: "min(load + 1, 4)", probability: up}
            - {value: "max(load - 1, 0)", probability: down}
            - {otherwise: load}
  configurations:
    calm: {up: 0.1, down: 0.3}
    rush: {up: 0.5, down: 0.1}
capability:
  parameters: {boot: probability}
  actions:
    keep: {stay: 1}
    grow: {stay: 1, requires: "booting = 0 & running < 4"}
    shrink: {stay: 1, requires: "running > 1"}
  processes:
    servers:
      variables:
        running: {range: [1, 4], initial: 1}
        booting: {range: [0, 1], initial: 0}
      changes:
        - {action: grow, set: {booting: 1}}
        - {action: shrink, set: {running: "running - 1"}}
        - where: "booting = 1"
          set:
            - {value: {running: "running + 1", booting: 0}, probability: boot}
            - {otherwise: {}}
  configurations:
    fast: {boot: 0.9}
    slow: {boot: 0.3}
objective:
  parameters: {w_time: real}
  start: here
  horizon: 30
  processes:
    seen: {values: [never, once], initial: never, changes: [{where: "load' = 4", set: once}]}
  rewards:
    - {value: "-w_time * max(load - running, 0) - running"}
  unsafe: "seen = once & running < 2"
  configurations:
    thrift: {w_time: 1}
    quality: {w_time: 4}
"""
