"""``python -m learner``: ``lndrl learner``, by the name that torchrun starts.

torchrun --nproc-per-node=2 -m learner lndrl --run-name mine
"""

import sys

if __name__ == "__main__":
    from lndrl.cli.main import main

    sys.argv.insert(1, "learner")
    main()
