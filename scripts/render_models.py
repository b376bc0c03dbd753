"""Render every combination of a case as a PRISM model: render_models.py CASE FOLDER."""

import sys
from pathlib import Path

import merap

case = merap.load_case(Path(sys.argv[1]))
folder = Path(sys.argv[2])
folder.mkdir(parents=True)
for combination in case.combinations():
    (folder / f"{combination.name}.prism").write_text(merap.render(combination))
    print(combination.name)
