"""``python -m fisheye_ep_calib``."""

import sys

from fisheye_ep_calib.cli import main

if __name__ == "__main__":
    sys.exit(main())
