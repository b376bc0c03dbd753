"""Render every combination of a case as a PRISM model: render_models.py CASE FOLDER."""

import sys

import merap
from merap.families import render_case

case = merap.load_case(sys.argv[1])
print(render_case(case, case.combinations(), sys.argv[2]), "models in", sys.argv[2])
