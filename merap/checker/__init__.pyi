from .storm import build_text as build_text
from .verdicts import Verdict as Verdict
from .verdicts import verify as verify

__all__: list[str]
