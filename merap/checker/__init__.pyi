from .checking import CheckedProperties as CheckedProperties
from .checking import Result as Result
from .checking import check as check
from .storm import build_text as build_text
from .verdicts import Verdict as Verdict

__all__: list[str]
