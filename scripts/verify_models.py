"""Build every combination of a case with Storm and check its properties: verify_models.py CASE."""

import sys
from pathlib import Path

import merap

case = merap.load_case(Path(sys.argv[1]))
for verdict in merap.verify(case):
    print(f"{verdict.combination:30} {verdict.name:22} {verdict.value} {verdict.reason or ''}")
