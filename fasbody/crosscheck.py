"""`python -m fasbody.crosscheck` has moved to python -m fasbody.arch crosscheck.

The old name goes with the next release.
"""

import runpy
import sys

if __name__ == "__main__":
    print(__doc__, file=sys.stderr)
    sys.argv.insert(1, "crosscheck")
    runpy.run_module("fasbody.arch", run_name="__main__")
