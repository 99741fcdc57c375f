"""Side-by-side numbers: accuracy against a tight solver, speed against what a user would otherwise run.

`make bench` runs all topics and writes results/benchmarks/HOST.md, with `--commit` RESULTS.md, too; `python -m
benchmarks.accuracy` (or callbacks, fitting, coverage) runs one. A checkout's tool, not part of the installed package.
"""
