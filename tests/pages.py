"""The documentation's pages as the tests read and run them.

The Python snippets of a page run in the order in which they stand, in one session. A ``text`` block
right behind a snippet is what it prints.
"""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted((*ROOT.glob("*.md"), *DOCS.rglob("*.md")))
_SNIPPET = re.compile(r"^```python\n(.*?)^```$(?:\n\n```text\n(.*?)^```$)?", re.S | re.M)


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.S | re.M)


def run(page: Path, device: str = "cuda") -> dict[str, object]:
    """Run the snippets of a page, whose output has to be what the page says.

    Args:
        page: the Markdown file.
        device: where Warp computes in place of the page's GPU.

    Returns:
        The names of the session. What the snippets print is printed, too.
    """
    session: dict[str, object] = {"__name__": "__main__"}
    text = page.read_text(encoding="utf-8").replace('"cuda"', f'"{device}"')
    with np.printoptions():
        for code, said in _SNIPPET.findall(text):
            with redirect_stdout(StringIO()) as out:
                exec(compile(code, str(page), "exec"), session)
            print(out.getvalue(), end="")
            if said:
                assert _plain(out.getvalue()) == _plain(said), f"{page}:\n{out.getvalue()}"
    return session


def _plain(text: str) -> str:
    """Return the text without the signs of zeros, which are rounding's, and the room for them."""
    return " ".join(re.sub(r"-(?=0\.?0*(?!\.?\d))", " ", text).replace("[ ", "[").split())
