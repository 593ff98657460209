"""The server's own process: `python -m wakedeploy.live DESCRIPTOR`, started by `process`."""

import sys

from wakedeploy.live.flying import main

if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
