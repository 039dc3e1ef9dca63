"""docs/formats.md holds today's table."""

from __future__ import annotations

from pumps_cli.commands.formats import with_table
from tests.docs.pages import ROOT


def test_the_page_of_formats_is_up_to_date():
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    assert with_table(page, "docs/formats.md") == page, "run `pumps formats --page docs/formats.md`"
