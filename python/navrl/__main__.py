"""`python -m navrl` is the command `navrl`."""

import sys

from navrl.cli import main

sys.exit(main())
