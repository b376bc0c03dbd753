from .storm import build_text as build_text
from .verdicts import Verdict as Verdict

__all__: list[str]
