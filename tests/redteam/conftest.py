"""What the end-to-end tests and the table of faults share is used here as well."""

import sys
from pathlib import Path

for _folder in ("e2e", "faults"):
    sys.path.append(str(Path(__file__).parents[1] / _folder))
