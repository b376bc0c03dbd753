"""Render the models of a case, 20 of them where there are many: render_models.py CASE FOLDER."""

import sys

import merap
from merap.families import render_case

case = merap.load_case(sys.argv[1])
chosen = case.combinations() if case.size <= 100 else case.sample(20, 0)
print(render_case(case, chosen, sys.argv[2]), "models in", sys.argv[2])
