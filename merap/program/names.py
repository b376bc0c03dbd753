"""Names that may stand in a case file, and near misses."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable

from merap.errors import InputError

IDENTIFIER = r"^[A-Za-z_][A-Za-z0-9_]*$"
MAX_NAME_LENGTH = 200


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# Tokens of PRISM-games' PrismParser.jj.
PRISM_GAMES_KEYWORDS = _words(
    """
    A bool clock const csg ctmc ctmdp C disc double dtmc E endinit endinvariant endmodule
    endobservables endplayer endrewards endsystem false formula filter func F Fc F0 global G idtmc imdp
    init invariant I int label maxmax maxmin max mdp minmax minmin min module X nondeterministic
    observable observables Pmaxmax Pmaxmin Pmax Pminmax Pminmin Pmin P player pomdp popta
    probabilistic prob pta rate rewards Rmaxmax Rmaxmin Rmax Rminmax Rminmin Rmin R S
    stochastic stpg smg system tptg true U W
    """
)

# `keywordsStruct` of Storm's PrismParserGrammar.h and FormulaParserGrammar.h, and its functions.
STORM_KEYWORDS = _words(
    """
    dtmc ctmc mdp ctmdp ma pomdp pta smg const int bool module endmodule rewards endrewards true
    false min max floor ceil init endinit atLeastOneOf atMostOneOf exactlyOneOf invariant
    endinvariant player endplayer formula label global system endsystem observables
    endobservables observable clock double F G X U C I P R S T LRA MP multi quantile HOA
    pow mod log rate
    """
)

KEYWORDS = PRISM_GAMES_KEYWORDS | STORM_KEYWORDS


def check_name(name: str, what: str) -> None:
    """Refuse a name that is no identifier.

    Raises:
        InputError: says what the name is of, and what is allowed.
    """
    if not re.match(IDENTIFIER, name) or name.endswith("\n"):
        raise InputError(
            f"illegal name {name!r} of {what}; allowed are letters, digits and _, the first no digit"
        )
    if len(name) > MAX_NAME_LENGTH:
        raise InputError(
            f"the name of {what} has {len(name)} characters, at most {MAX_NAME_LENGTH} are allowed"
        )


def unique_name(name: str, taken: Collection[str]) -> str:
    """Return a name with as many underscores behind it as it takes to be neither taken nor a keyword."""
    while name in taken or name in KEYWORDS:
        name += "_"
    return name


def suggestion(name: str, known: Iterable[str]) -> str:
    """`; did you mean 'a' or 'b'?`, or `; known: ...` if nothing is near."""
    candidates = list(known)
    near = difflib.get_close_matches(name, candidates, n=3)
    if near:
        return f"; did you mean {' or '.join(map(repr, near))}?"
    if not candidates:
        return "; there are none"
    shown = ", ".join(candidates[:12]) + (f" and {len(candidates) - 12} more" if len(candidates) > 12 else "")
    return f"; known: {shown}"
