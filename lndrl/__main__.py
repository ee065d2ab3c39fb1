"""``python -m lndrl``: the command line."""

from lndrl.cli.main import main

if __name__ == "__main__":
    main()
