"""``python -m lndrl``: the command line, whatever lies in the working folder."""

import os
import sys

if __name__ == "__main__":
    # Python looks in the working folder first, where a user's own learner.py must not stand in for
    # ours. A checkout that is not installed is found there, so that one stays.
    if not sys.flags.safe_path:
        root = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
        if os.path.realpath(sys.path[0]) != root:
            del sys.path[0]

    from lndrl.cli.main import main

    main()
