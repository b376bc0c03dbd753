"""merap: meta-reinforcement-learning adaptive planning over checked Markov decision processes.

`__init__.pyi` lists the public names. They are imported when first used, so that looking at a
case does not wait for torch.
"""

from importlib import metadata

import lazy_loader

_attached, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name, or the version."""
    return metadata.version(__name__) if name == "__version__" else _attached(name)
