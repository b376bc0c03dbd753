"""merap: meta-reinforcement-learning adaptive planning over checked Markov decision processes.

`__init__.pyi` lists the public names. They are imported when first used, so that looking at a
case does not wait for torch.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
