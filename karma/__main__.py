"""`python -m karma`: the command line."""

import sys

if not sys.flags.safe_path and __name__ == "__main__":
    del sys.path[0]  # `-m` has put the current folder there; ours is known by now

from karma.cli import main

if __name__ == "__main__":  # worker processes import this module again
    main()
