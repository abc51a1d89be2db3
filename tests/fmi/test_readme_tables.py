"""The port tables of the READMEs are those of the declarations."""

from __future__ import annotations

import pytest
from fmi_driver import NAMES

from rotordx.fmus import load_component
from rotordx.fmus.shell.readme import readme_path, updated


@pytest.mark.parametrize("name", NAMES)
def test_port_table_is_current(name):
    text = readme_path(name).read_text(encoding="utf-8")
    assert updated(text, load_component(name)) == text, "run python -m rotordx.fmus.shell.readme"
