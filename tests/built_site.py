"""The built site: what `make docs` runs behind the build, on build/site.

No page asks another machine for anything, every link leads somewhere, every public name is
documented, and the words that a newcomer types lead to the page that is meant.
"""

import ast
import importlib
import inspect
import json
import re
import zlib
from html.parser import HTMLParser
from urllib.parse import quote, unquote, urlsplit

import pytest
from browser import needs_browser
from pages import ROOT

import graspforce as gf

SITE = ROOT / "build" / "site"
HTML = sorted(path for path in SITE.rglob("*.html") if "_static" not in path.parts)
MODULES = (
    "baselines", "control", "equations", "figures", "files", "firmness", "guaranteed", "hands",
    "payload", "reference", "regrasp", "robust", "scenarios", "sim", "soles", "trajectory", "warp",
)  # fmt: skip
FIRST_FOR = {
    "friction cone": "understand/problem",
    "torque limit": "understand/problem",
    "urdf": "do/urdf",
    "infeasible": "do/infeasible",
    "alpha": "do/alpha",
    "batch": "batch",
    "gradient": "do/gradients",
    "learning": "do/learn",
    "position control": "do/position",
    "slip": "understand/problem",
    "regrasp": "do/regrasp",
    "real time": "do/loop",
}


class _Page(HTMLParser):
    """What a page loads, where it links to, and the places in it that can be linked to."""

    def __init__(self, text):
        super().__init__()
        self.loads, self.links, self.ids = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids |= {given["id"]} if "id" in given else set()
        if tag == "a":
            self.links += [given["href"]] if "href" in given else []
        elif tag == "link":
            self.loads += [] if given.get("rel") == "canonical" else [given["href"]]
        elif "src" in given:
            self.loads.append(given["src"])


@pytest.fixture(scope="module")
def pages():
    assert len(HTML) > 50
    return {path: _Page(path.read_text(encoding="utf-8")) for path in HTML}


def test_nothing_is_loaded_from_elsewhere(pages):
    for path, page in pages.items():
        assert not [url for url in page.loads if urlsplit(url).netloc], path
    styles = [path.read_text(encoding="utf-8") for path in SITE.rglob("*.css")]
    assert styles
    asked = re.compile(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//")
    assert not [text for text in styles if asked.search(text)]


def test_every_link_leads_somewhere(pages):
    count = 0
    for path, page in pages.items():
        for link in {*page.links, *page.loads}:
            url = urlsplit(link)
            if url.scheme:
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            assert target.exists(), f"{path.name}: {link}"
            if url.fragment and target.suffix == ".html":
                assert unquote(url.fragment) in pages[target].ids, f"{path.name}: {link}"
            count += 1
    assert count > 1000


@pytest.mark.parametrize("name", ["plot_paper", "plot_own_hand", "plot_learning"])
def test_a_tutorial_can_be_taken_along_as_a_notebook(pages, name):
    page = SITE / "gallery" / "tutorials" / f"{name}.html"
    links = [link for link in pages[page].links if link.endswith(".ipynb")]
    assert len(links) == 1
    notebook = json.loads((page.parent / unquote(links[0])).read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 4
    # It is the program that the build has run: the same statements, in the same order.
    program = (ROOT / "examples" / "gallery" / "tutorials" / f"{name}.py").read_text()
    made = ast.parse("\n".join("".join(cell["source"]) for cell in cells))
    of_file = ast.parse(program).body[1:]  # without its docstring, which is text there
    of_notebook = [each for each in made.body if "matplotlib inline" not in ast.unparse(each)]
    assert [ast.dump(each) for each in of_notebook] == [ast.dump(each) for each in of_file]


def documented():
    """Return the names of the site's inventory of Python objects."""
    raw = (SITE / "objects.inv").read_bytes().split(b"\n", 4)[4]
    lines = zlib.decompress(raw).decode().splitlines()
    return {line.split(" ")[0] for line in lines if " py:" in line}


def public(module):
    """Return what a module's __all__ names, or else the functions and classes that it defines."""
    if hasattr(module, "__all__"):
        return [name for name in module.__all__ if not inspect.ismodule(getattr(module, name))]
    return [
        name
        for name, value in vars(module).items()
        if not name.startswith("_")
        and (inspect.isfunction(value) or inspect.isclass(value))
        and value.__module__ == module.__name__
    ]


def test_every_public_name_is_documented():
    known = documented()
    wanted = [f"graspforce.{name}" for name in public(gf)]
    for name in MODULES:
        module = importlib.import_module(getattr(gf, name).__name__)
        wanted += [module.__name__] + [f"{module.__name__}.{each}" for each in public(module)]
    wanted += [f"graspforce.baselines.{name}.solve" for name in gf.baselines.METHODS]
    wanted += ["graspforce.torch.solve", "graspforce.jax.solve"]  # whose packages are not here
    missing = sorted(set(wanted) - known)
    assert not missing


@needs_browser
def test_the_sites_own_search_shows_that_page_first(browser):
    tab = browser.new_page()
    tab.set_default_timeout(60_000)
    for words, page in FIRST_FOR.items():
        tab.goto(f"{(SITE / 'search.html').as_uri()}?q={quote(words)}")
        first = tab.locator("#search-results ul.search > li > a").first
        first.wait_for()
        found = urlsplit(tab.evaluate("a => a.href", first.element_handle())).path
        assert found == str(SITE / f"{page}.html"), words
    tab.close()


@needs_browser
def test_no_page_is_wider_than_a_phone(browser):
    tab = browser.new_page(viewport={"width": 390, "height": 800})
    wide = []
    for page in HTML:
        tab.goto(page.as_uri(), wait_until="domcontentloaded")
        if tab.evaluate("document.documentElement.scrollWidth") > 390:
            wide.append(page.relative_to(SITE))
    tab.close()
    assert not wide


def test_what_newcomers_type_finds_the_page_first():
    text = (SITE / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    for words, page in FIRST_FOR.items():
        # Only a main entry, "! word" in the page, comes before titles and names of objects.
        entries = index["indexentries"].get(words, [])
        found = [index["docnames"][number] for number, _, is_main in entries if is_main]
        assert found == [page], words
