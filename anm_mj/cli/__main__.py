"""``python -m anm_mj.cli`` is ``anm-mj``."""

import sys

from anm_mj.cli.main import main

sys.exit(main())
