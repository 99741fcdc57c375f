"""Side-by-side numbers: accuracy against a tight solver, speed against what a user would otherwise run.

`make bench` runs all topics and writes RESULTS.md; `python -m benchmarks.accuracy` (or callbacks, fitting, coverage)
runs one. A checkout's tool, not part of the installed package.
"""
