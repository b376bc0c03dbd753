from .curves import draw_adaptation as draw_adaptation
from .map import draw_before_after as draw_before_after
from .map import draw_combination as draw_combination
from .map import draw_map as draw_map
from .map import has_map as has_map
from .path import RoutePath as RoutePath
from .path import most_likely_path as most_likely_path
from .saving import save_figure as save_figure
from .timeline import draw_timeline as draw_timeline

__all__: list[str]
