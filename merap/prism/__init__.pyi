from .rendering import render as render

__all__: list[str]
