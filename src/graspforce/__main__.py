"""``python -m graspforce``: the same as the command ``graspforce``."""

from graspforce.cli import main

if __name__ == "__main__":
    main()
