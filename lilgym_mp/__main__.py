"""`python -m lilgym_mp` is the command `lilgym-mp`."""

import sys

from lilgym_mp_command import main

sys.exit(main())
