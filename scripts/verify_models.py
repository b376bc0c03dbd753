"""Build every combination of a case with Storm and check its properties: verify_models.py CASE."""

import sys

import merap

for verdict in merap.verify(sys.argv[1]):
    print(f"{verdict.combination:30} {verdict.name:22} {verdict.value} {verdict.reason or ''}")
