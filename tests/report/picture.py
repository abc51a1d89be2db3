"""The README's picture: the top of a real report, as a browser shows it.

python -m tests.report.picture RESULT_FOLDER orchestrator/report.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from rotordx.orchestrator.results import REPORT
from tests.report.browser import browser, new_page

WIDTH = 1240  # px
LAST_FIGURE = "detection"  # the picture ends below it


def take(report: Path, picture: Path) -> None:
    """Write a PNG of a report from its verdict to its detection residuals."""
    with browser() as port, new_page(port) as page:
        page.open(report, width=WIDTH)
        bottom = page.run(f"document.querySelector('[id$={LAST_FIGURE}]').getBoundingClientRect().bottom + 20")
        picture.write_bytes(page.screenshot(bottom=bottom))


if __name__ == "__main__":
    take(Path(sys.argv[1]) / REPORT, Path(sys.argv[2]))
