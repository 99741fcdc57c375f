"""`python -m fasbody.reduction` has moved to python -m fasbody.arch reduction.

The old name goes with the next release.
"""

import runpy
import sys

if __name__ == "__main__":
    print(__doc__, file=sys.stderr)
    sys.argv.insert(1, "reduction")
    runpy.run_module("fasbody.arch", run_name="__main__")
