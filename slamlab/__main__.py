"""``python -m slamlab COMMAND``: the door to `slamlab.commands`."""

import sys

if __name__ == "__main__":
    try:
        from slamlab.commands import main

        sys.exit(main())
    except KeyboardInterrupt:  # before a command has begun
        print("slamlab: interrupted", file=sys.stderr)
        sys.exit(130)
