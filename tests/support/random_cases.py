"""Random small case files: processes in every concern, doors, sets, links, with and without a space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hypothesis import strategies as st

Draw = Any  # hypothesis's own type is private
Case = dict[str, Any]

LINE = {
    "locations": {"a": [0, 0], "b": [1, 0], "c": [2, 0]},
    "edges": [["a", "b", "right"], ["b", "c", "right"], ["c", "b", "left"], ["b", "a", "left"]],
}
DOORS = {
    "door": {"between": ["a", "b"], "open": True},
    "gate": {
        "between": ["c", "b"],
        "open": False,
        "changes": [{"where": "moved", "set": [{"value": True, "probability": "p"}, {"otherwise": False}]}],
    },
}
GRID = {"grid": {"rows": 2, "cols": 2, "moves": {"right": [0, 1], "left": [0, -1], "down": [1, 0]}}}
SPACES = {"line": LINE, "doors": {**LINE, "doors": DOORS}, "grid": GRID}
MOVES: dict[str, list[str]] = {
    "line": ["right", "left"],
    "doors": ["right", "left"],
    "grid": ["right", "down"],
    "none": [],
}
PLACES = {
    "line": ["at(a)", "at(c)", "at([a, b])"],
    "doors": ["at(a)", "at(c)", "at([a, b])", "door", "gate"],
    "grid": ["at([0, 1])", "row = 1", "col + row > 0"],
    "none": [],
}
CHANGES = {
    "line": ["at'(b)", "moved"],
    "doors": ["at'(b)", "moved", "gate'", "!door'"],
    "grid": ["moved", "row' >= row", "at'([[0, 1], [1, 1]])"],
    "none": [],
}
SCAN = {
    "name": "scan",
    "modes": ["idle", "busy"],
    "entry": "busy",
    "initial": "idle",
    "terminal": ["idle"],
    "actions": {"finish": {"busy": {"idle": 0.3, "busy": 0.7}}},
}
CHANCES = [0, 0.1, 0.3, 0.9, 1, "p", "1 - p", "0.9 + 0.1 * p", "p / 3"]


def condition(draw: Draw, reads: Sequence[str]) -> str:
    """An expression that is true or false."""
    clause = draw(st.sampled_from([*reads, "p < 0.3", "true"]))
    form = draw(st.sampled_from(["{0}", "!({0})", "{0} & {1}", "{0} | {1}", "{0} => {1}", "{0} ? {1} : {0}"]))
    return str(form.format(f"({clause})", f"({draw(st.sampled_from([*reads, 'p > 0']))})"))


KINDS: dict[str, Case] = {
    "bool": {"type": "bool", "initial": False},
    "bit": {"range": [0, 1], "initial": 1},
    "number": {"range": [0, 3], "initial": 0},
    "rising": {"values": ["low", "mid", "high"], "initial": "low"},
    "falling": {"values": ["high", "low"], "initial": "low"},
}


def clauses(name: str, kind: str, prime: str) -> list[str]:
    """Conditions on a variable."""
    read = f"{name}{prime}"
    if kind == "bool":
        return [read, f"!{read}"]
    if kind in ("rising", "falling"):
        return [f"{read} = low", f"{read} != high"]
    high = KINDS[kind]["range"][1]
    return [f"{read} > 0", f"{read} = {high}", f"0.1 * {read} <= 0.3", f"mod({read} - 2, 2) = 1"]


def new_values(name: str, kind: str) -> list[str]:
    """What a variable may become."""
    if kind == "bool":
        return ["true", "false", f"!{name}", name]
    if kind in ("rising", "falling"):
        return ["low", "high", f"{name} = low ? high : low", f"{name} = high ? {name} : low"]
    high = KINDS[kind]["range"][1]
    steps = [f"min({name} + 1, {high})", f"max({name} - 1, 0)", f"{name} + 1"]
    return ["0", f"{high} - {name}", *steps]


def process(
    draw: Draw, name: str, kind: str, actions: Sequence[str], reads: list[str], *, certain: bool
) -> Case:
    """A process of one variable; a certain one draws nothing."""
    known = [*reads, *clauses(name, kind, "")]
    changes = [
        draw(
            st.fixed_dictionaries(
                {"set": given(draw, new_values(name, kind), certain=certain)},
                optional={
                    "where": st.just(condition(draw, known)),
                    "action": st.sampled_from([*actions, [actions[0], actions[-1]], "any"]),
                },
            )
        )
        for _ in range(draw(st.integers(0, 2)))
    ]
    return KINDS[kind] | {"changes": changes}


def pair(draw: Draw, reads: list[str]) -> Case:
    """A process of two variables, `s` and `t`, that are drawn together."""
    outcomes = [
        {"value": {"s": "!s"}, "probability": draw(st.sampled_from(CHANCES))},
        {"value": {"t": "1 - t", "s": "t = 1"}, "probability": "p / 3"},
        {"otherwise": draw(st.sampled_from([{}, {"t": 0}]))},
    ]
    return {
        "variables": {"s": {"type": "bool"}, "t": {"range": [0, 1]}},
        "initial": [{"value": {"s": True, "t": 0}, "probability": "p"}, {"otherwise": {"s": False, "t": 1}}],
        "changes": [{"where": condition(draw, reads), "set": outcomes}, {"action": "rest", "set": {"t": 0}}],
    }


def given(draw: Draw, values: Sequence[str], *, certain: bool) -> st.SearchStrategy[Any]:
    """What `set` says."""
    if certain or draw(st.booleans()):
        return st.sampled_from(list(values))
    outcomes = [
        {"value": draw(st.sampled_from(list(values))), "probability": draw(st.sampled_from(CHANCES))},
        {"otherwise": draw(st.sampled_from(list(values)))},
    ]
    return st.just(outcomes)


@st.composite
def random_cases(draw: Draw) -> Case:
    """A case with one configuration of each concern; it may be wrong in a reachable state."""
    world = draw(st.sampled_from(["line", "doors", "grid", "none"]))
    innate = {"innate": SCAN} if draw(st.booleans()) else {}
    actions = ["rest", "work", *MOVES[world]]
    before, after = [*PLACES[world]], [*CHANGES[world]]  # what can be read of a state, and of a step
    if innate:
        before.append("mode = idle")
    both = pair(draw, [*before, *after, "s", "t > 0"])
    before += ["s", "t = 0"]
    after += ["s'", "t' > t"]
    drawn, kinds = {}, {}
    for name, certain in (("u", False), ("v", False), ("w", False), ("z", True)):
        outer, kind = [*before], draw(st.sampled_from(list(KINDS)))
        known = [*actions, "start_scan"] if innate else actions
        if innate and name == "w":  # the environment does not read what the capability decides
            after.append("mode' = busy")
        drawn[name] = process(draw, name, kind, known, [*before, *after], certain=certain)
        kinds[name] = kind
        before += clauses(name, kind, "")
        after += clauses(name, kind, "'")
    sets: Case = {"u": draw(given(draw, new_values("u", kinds["u"]), certain=False))}
    if draw(st.booleans()):
        sets["u"] = {"where": condition(draw, outer), "set": sets["u"]}
    locked = {"locked": draw(st.sampled_from([[], ["gate"], ["door"]]))} if world == "doors" else {}
    if locked:
        sets["gate"] = {"where": "at(b) | at(c)", "set": True}
    return {
        "case": "random",
        "discount": draw(st.sampled_from([1, 0.9])),
        **({} if world == "none" else {"space": SPACES[world]}),
        "environment": {
            "parameters": {"p": "probability", **dict.fromkeys(locked, "doors")},
            "processes": {"both": both, "u": drawn["u"], "v": drawn["v"]},
            "configurations": {"e": {"p": draw(st.sampled_from([0, 0.1, 0.5, 1])), **locked}},
        },
        "capability": {
            "actions": {
                "rest": {},
                "work": {"requires": f"s | ({condition(draw, outer)})", "sets": sets},
                **{name: move(draw, name, sets) for name in actions[2:]},
            },
            **innate,
            "processes": {"w": drawn["w"]},
        },
        "objective": {
            **({} if world == "none" else {"start": [0, 0] if world == "grid" else "a"}),
            "processes": {"z": drawn["z"]},
            **wishes(draw, before, after),
        },
    }


def wishes(draw: Draw, before: Sequence[str], after: Sequence[str]) -> Case:
    """What an objective says beside its processes."""
    ends: Case = draw(
        st.fixed_dictionaries(
            {},
            optional={
                "ends_in": st.just(condition(draw, ['"goal"', *before])),
                "ends_after": st.just({"action": "work", "where": condition(draw, before)}),
            },
        )
    )
    return ends | {
        "horizon": 5,
        "labels": {"special": condition(draw, before)},
        "goal": condition(draw, before),
        "unsafe": '"special" & !"goal"',
        "rewards": [
            {"where": condition(draw, [*before, *after]), "value": "p * 2 - 1"},
            {"action": "work", "value": 0.1},
            {"where": '"special"', "value": "-3"},
        ],
    }


def move(draw: Draw, label: str, sets: Case) -> Case:
    """An action that moves, perhaps, and sets something with it."""
    chance = draw(st.sampled_from(CHANCES))
    form = draw(st.sampled_from(["plain", "outcomes", "disable"]))
    if form == "plain":
        return {"move": label, "probability": chance, "otherwise": "stay"}
    if form == "disable":
        return {"move": label, "on_blocked": "disable", "sets": sets}
    return {
        "outcomes": [
            {"move": label, "probability": chance, "sets": sets},
            {"move": "stay", "probability": f"1 - ({chance})"},
        ]
    }
