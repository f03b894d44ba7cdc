"""The site that Sphinx makes of docs/ and docstrings: builds without a warning, and reads without a network."""

import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest

import anm_mj
from tests.docs.pages import ROOT

pytest.importorskip("sphinx", reason="the site needs the extra docs")

ELSEWHERE = re.compile(r"^\s*(?:[a-z]+:)?//", re.IGNORECASE)
FETCHED = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src", "object": "data"}
"""Elements that a browser fetches, and the attribute that says what; links to click on are none of them."""


class Fetched(HTMLParser):
    """Collects what a browser fetches to show a page."""

    def __init__(self):
        super().__init__()
        self.addresses = []

    def handle_starttag(self, tag, attrs):
        self.addresses += [value for name, value in attrs if name == FETCHED.get(tag) and value]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site; a warning of the build is an error."""
    folder = tmp_path_factory.mktemp("site")
    command = ["-q", "-W", "--keep-going", "-d", str(folder / "doctrees"), "docs", str(folder / "site")]
    done = subprocess.run([sys.executable, "-m", "sphinx", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


def test_nothing_is_fetched_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        reader = Fetched()
        reader.feed(page.read_text(encoding="utf-8"))
        assert reader.addresses
        for address in reader.addresses:
            assert not ELSEWHERE.match(address), (page.name, address)
            if not address.startswith("data:"):
                assert (page.parent / re.sub(r"[?#].*", "", address)).exists(), (page.name, address)
    for style in site.rglob("*.css"):
        assert not re.findall(r"@import|url\([\"']?(?:https?:)?//", style.read_text(encoding="utf-8")), style.name


def test_public_names_are_documented(site):
    page = "".join(path.read_text(encoding="utf-8") for path in (site / "api").glob("*.html"))
    assert [name for name in anm_mj.__all__ if f'id="anm_mj.{name}"' not in page] == []
    for name in ("mapping.neural_map.NeuralMap.sdf", "types.Plan", "protocols.Mapper.occupancy_grid"):
        assert f'id="anm_mj.{name}"' in page


def test_files_that_a_page_names_are_links_and_code_has_buttons(site):
    page = (site / "robot.html").read_text(encoding="utf-8")
    (copied,) = set(re.findall(r'href="(_downloads/[^"]+/presets\.toml)"', page))
    assert (site / copied).read_bytes() == (ROOT / "models" / "presets.toml").read_bytes()
    assert 'src="_static/copy.js' in page
    assert (site / "_static" / "copy.js").is_file()
