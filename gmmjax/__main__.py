"""`python -m gmmjax`: the command line."""

import sys

from gmmjax.cli import main

if __name__ == "__main__":
    sys.exit(main())
