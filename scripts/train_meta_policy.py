"""Train a meta policy for a case and adapt it to the system `met`: train_meta_policy.py CASE FOLDER."""

import sys

import merap

run = merap.train(sys.argv[1], sys.argv[2])
adaptation = merap.adapt(run, "met", strategy="gradient", episodes_per_step=35, steps=10, seeds=range(3))
print(f"optimum {adaptation.reachable.optimum:.2f}")
for one in adaptation.runs:
    print(f"seed {one.seed}:", " ".join(f"{row.expected_return:.2f}" for row in one.curve))
