"""Finite Markov decision processes as arrays: planning, comparison, UMB files, Gymnasium environments.

`__init__.pyi` lists the public names, which are imported when first used.
"""

from merap.lazy import exports

__getattr__, __dir__, __all__ = exports(__name__, __file__)
