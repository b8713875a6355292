"""`python -m tests.broken` writes the tables of docs/conformance.md anew."""

from tests.broken.table import PAGE, page_with_tables

PAGE.write_text(page_with_tables(), encoding="utf-8")
