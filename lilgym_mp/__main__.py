"""`python -m lilgym_mp` is the command `lilgym-mp`."""

import sys

from lilgym_mp.cli import main

sys.exit(main())
