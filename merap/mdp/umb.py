"""Read and write MDPs in the unified Markov binary format (UMB), the way to and from Storm.

An archive is a tar file of raw little-endian arrays. One that isn't compressed is mapped
into memory and its arrays are used in place, so the file must not be written over in place
while the model lives; replacing it, as `write_umb` does, is fine.

Source: the specification, version 1.0 (https://github.com/pmc-tools/umb, spec.md).
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from merap.errors import ModelError
from merap.mdp.model import TabularMDP
from merap.mdp.umb_archive import open_archive, write_archive
from merap.mdp.umb_decoding import decode
from merap.mdp.umb_encoding import encode
from merap.mdp.umb_index import parse_index


def read_umb(
    path: str | PathLike[str], reward: str | None = "objective", *, numbered: bool = False
) -> TabularMDP:
    """Read an MDP or a Markov chain; the one action of a chain is called `step`.

    State and choice rewards are added up, as are the means of branch rewards. Several
    initial states are equally likely unless a distribution is stored. Branches of one choice
    to one state become one branch with the sum of their probabilities and the mean of their
    rewards; branches of probability 0 are dropped. Rationals are rounded to doubles. Actions
    without names are called `a0`, `a1`, ...

    Args:
        path: an archive, plain or compressed by gzip or xz.
        reward: name of the reward structure; None for rewards of 0.
        numbered: call further choices of one action in a state `a#2`, `a#3`, ..., and where there are no
            state valuations, number the states by a variable `state`.

    Returns:
        The model; states and choices keep the archive's numbers.

    Raises:
        InputError: the file isn't a UMB archive, is damaged, contradicts itself, has no such
            reward or no state valuations, or isn't an MDP in discrete time.
        ModelError: an invariant of `TabularMDP` does not hold.
    """
    archive = open_archive(Path(path))
    index = parse_index(bytes(archive.content("index.json")), archive.source)
    try:
        return decode(archive, index, reward, numbered=numbered)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from error


def write_umb(
    mdp: TabularMDP,
    path: str | PathLike[str],
    *,
    reward: str = "objective",
    as_chain: bool = False,
    overwrite: bool = False,
) -> None:
    """Write an archive that Storm and `read_umb` read back; equal models give equal bytes.

    Args:
        mdp: a model whose states all have a choice (see `restrict_to_reachable`).
        path: the file to write, an uncompressed tar file.
        reward: the name of the rewards in it.
        as_chain: write a Markov chain; every state must have exactly one choice.
        overwrite: replace a file that is there.

    Raises:
        ModelError: a state has no choice, or several although `as_chain`; a label is
            called `init`, which the format reserves.
        OutputError: the file is there already or can't be written.
    """
    write_archive(Path(path), encode(mdp, reward, as_chain=as_chain), overwrite=overwrite)
