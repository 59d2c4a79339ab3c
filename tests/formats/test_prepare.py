"""What is imported ahead for the files that will be written."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("paths", "imported"),
    [
        (["a.svg"], True),
        (["a.json", "b.SVGZ"], True),
        (["a.json", "a.json.gz"], False),
        ([], False),
    ],
)
def test_svgwrite_is_imported_only_if_it_will_be_needed(paths: list[str], imported: bool) -> None:
    code = (
        "import sys; from strokeplan.formats import prepare; before = 'svgwrite' in sys.modules; "
        f"prepare({paths!r}); print(before, 'svgwrite' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == (f"False {imported}\n", "")
