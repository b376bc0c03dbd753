from .build import ModelBase as ModelBase
from .build import build_base as build_base
from .loading import load_case as load_case
from .models import built as built
from .models import explored as explored
from .verification import verify as verify
from .writing import export_case as export_case
from .writing import render_case as render_case

__all__: list[str]
