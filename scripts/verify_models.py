"""Have Storm build and check the models of a case, 20 where there are many: verify_models.py CASE."""

import sys

import merap

case = merap.load_case(sys.argv[1])
chosen = case.combinations() if case.size <= 100 else case.sample(20, 0)
for verdict in merap.verify(chosen):
    print(f"{verdict.combination:30} {verdict.name:22} {verdict.value} {verdict.reason or ''}")
