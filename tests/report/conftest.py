"""A browser for all tests of the report."""

from __future__ import annotations

import pytest

from tests.report.browser import CHROMIUM, NO_CHROMIUM, browser, new_page


@pytest.fixture(scope="session")
def page():
    """A page in a headless Chromium; whatever is opened in it replaces what was there."""
    if CHROMIUM is None:
        pytest.skip(NO_CHROMIUM)
    with browser() as port, new_page(port) as empty_page:
        yield empty_page
