"""``python -m slamlab COMMAND``: the door to `slamlab.commands`."""

import sys

from slamlab.commands import main

if __name__ == "__main__":
    sys.exit(main())
