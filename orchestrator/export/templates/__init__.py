"""Files of an export with gaps, and how they are filled.

A gap is written @name@. The names of the files end in `.in`, for they are no valid C before.
"""

from __future__ import annotations

import re
from importlib.resources import files


def filled(template: str, **values: object) -> str:
    """Contents of a template with every gap filled; a value that no gap asks for is passed over.

    Raises:
        KeyError: there is no value for a gap.
    """
    text = files("rotordx.orchestrator.export.templates").joinpath(template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda gap: str(values[gap[1]]), text)
