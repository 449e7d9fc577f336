"""The page in a browser: headless Chromium loads it, clicks, types, drags and downloads.

Needs Chromium and its driver (Debian: chromium, chromium-driver) and the extra ``browser``; is
skipped where one of them is missing.
"""

from __future__ import annotations

import csv
import dataclasses
import importlib
import io
import json
import shutil
import time
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from zoo import ROOT

from contimpact.diagrams.explore import follow
from contimpact.page.data import PageView, page_data, read_sweep
from contimpact.page.document import FOLDER, LIBRARY, page_text, view
from contimpact.results.catalogue import Bound, Motion, Share
from contimpact.results.scene import read_scene
from contimpact.simulation.files import sweep_text
from contimpact.simulation.sweep import sweep

webdriver = pytest.importorskip("selenium.webdriver", reason="pip install contimpact[browser]")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="no browser: apt-get install chromium chromium-driver"
    ),
]

FLAGS = """--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-sync
--disable-background-networking --disable-component-update --disable-dev-shm-usage
--force-device-scale-factor=1 --hide-scrollbars --window-size=1400,1000""".split()
LOOKED_AT = Path(__file__).parent / "looked_at"
"""Pictures that somebody has looked at, small, grey, and without texts."""
SCRIPT = "<script>alert(1)</script>"
TRIED = {
    "fig7": {},
    "fig8": {"follow": {"max_branches": 3, "survey": False}},
    "fig6b": {
        "follow": {"range": [0.8, 40.0]},
        "detect": {"events": ["FB", "PD", "G"]},
        "curves": {
            "family": {"beta": ["pi/6"]},
            "start": [0.7],
            "kinds": ["PD", "G"],
            "cover": 0,
            "areas": False,
            "max_step": 0.05,
        },
    },
    "stop": {},
}
"""Scenes of the paper, some of them shortened."""


CORNERS = """
const frame = document.querySelector(arguments[0]).getBoundingClientRect();
const texts = document.querySelectorAll(`${arguments[0]} text`);
return [...texts].filter(text => text.textContent).map(text => {
  const {x, y, width, height} = text.getBBox(), turn = text.getScreenCTM();
  const inset = Math.min(2, height / 4), low = y + inset, high = y + height - inset;
  return [[x, low], [x + width, low], [x + width, high], [x, high]].map(([px, py]) => {
    const at = new DOMPoint(px, py).matrixTransform(turn);
    return [at.x - frame.x, at.y - frame.y];
  });
});"""
"""The corners of each text of a picture, turned as it is, a little less high than its line."""


def pairs_that_meet(boxes):
    """Pairs of turned boxes that have no line between them: none of their sides parts them."""

    def apart(one, other):
        for box in (one, other):
            sides = np.roll(box, -1, axis=0) - box
            for normal in np.stack([-sides[:2, 1], sides[:2, 0]], axis=1):
                a, b = one @ normal, other @ normal
                if a.max() < b.min() or b.max() < a.min():
                    return True
        return False

    boxes = [np.array(box) for box in boxes]
    return [(i, j) for j in range(len(boxes)) for i in range(j) if not apart(boxes[i], boxes[j])]


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    folder = tmp_path_factory.mktemp("browser")
    for flag in [*FLAGS, f"--user-data-dir={folder / 'profile'}"]:
        options.add_argument(flag)
    logs = {"browser": "ALL", "performance": "ALL"}
    options.set_capability("goog:loggingPrefs", logs)
    chrome = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        yield chrome
    finally:
        chrome.quit()


class Reader:
    """Who looks at a page: finds, clicks, types, and notes what the browser complains of."""

    def __init__(self, driver, path, downloads):
        self.driver, self.path, self.downloads = driver, path, downloads
        allowed = {"behavior": "allow", "downloadPath": str(downloads)}
        driver.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)

    def open(self, fragment=""):
        self.driver.get("about:blank")
        self.driver.get_log("performance"), self.driver.get_log("browser")
        self.driver.get(f"{self.path.as_uri()}#{fragment}")
        assert self.run("return document.documentElement.dataset.ready") == "true"
        return self

    def run(self, script, *given):
        return self.driver.execute_script(script, *given)

    def all(self, selector):
        return self.driver.find_elements("css selector", selector)

    def one(self, selector):
        return self.driver.find_element("css selector", selector)

    def text(self, selector):
        return self.run("return document.querySelector(arguments[0]).textContent", selector)

    def click_at(self, selector):
        """Click an element of a picture where it is drawn."""
        self.run("document.querySelector(arguments[0]).scrollIntoView({block: 'center'})", selector)
        mouse = webdriver.ActionChains(self.driver)
        mouse.move_to_element(self.one(selector)).click().perform()

    def keys(self, selector, *keys):
        self.one(selector).send_keys(*keys)

    def choose(self, selector, value):
        self.run(
            "const e = document.querySelector(arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event('input')); e.dispatchEvent(new Event('change'))",
            selector,
            value,
        )

    def limits(self):
        """First and last tick of the x axis."""
        ticks = self.run(
            "return [...document.querySelectorAll('#diagram g.below text')].map(t => t.textContent)"
        )
        return float(ticks[0].replace("\u2212", "-")), float(ticks[-1].replace("\u2212", "-"))

    def fragment(self):
        time.sleep(0.3)  # the address is written when nothing has changed for a while
        return self.run("return location.hash")

    def downloaded(self, name):
        """A file that was downloaded; its name is there before all of its content is."""
        until = time.monotonic() + 10.0
        while not (found := [f for f in self.downloads.glob(f"*{name}") if f.stat().st_size]):
            assert time.monotonic() < until, f"no {name} in {list(self.downloads.iterdir())}"
            time.sleep(0.02)
        return found[0]

    def table(self, name):
        """The rows of a table that was downloaded."""
        return list(csv.DictReader(self.downloaded(name).read_text(encoding="utf-8").splitlines()))

    def complaints(self):
        """Messages of the console, and requests that would have left the page."""
        said = [entry["message"] for entry in self.driver.get_log("browser")]
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                address = message["params"]["request"]["url"]
                if not address.startswith((self.path.as_uri(), "data:", "blob:", "about:")):
                    said.append(address)
        return said


@pytest.fixture
def reader(driver, tmp_path):
    """``reader(diagram, scene)``: a page in the browser; nothing may have been complained of."""
    readers = []

    def opened(diagram, scene, fragment="", swept=(), **more):
        plot, path = scene.plot, tmp_path / "diagram.html"
        begins = plot.x, plot.xlim, plot.ylim, plot.unphysical
        shown = PageView(*begins, scene.source, margin=plot.margin)
        text = page_text(page_data(diagram, scene.model, shown, swept, **more))
        path.write_text(text, encoding="utf-8")
        (tmp_path / "downloads").mkdir(exist_ok=True)
        readers.append(Reader(driver, path, tmp_path / "downloads"))
        return readers[-1].open(fragment)

    yield opened
    assert [said for one in readers for said in one.complaints()] == []


@pytest.fixture(scope="session")
def computed():
    """``computed(name)``: a scene of the paper, followed once."""
    known = {}

    def compute(name):
        if name not in known:
            given = tomllib.loads((ROOT / "branches" / name / "scene.toml").read_text("utf-8"))
            for table, changes in TRIED[name].items():
                given[table] |= changes
            scene = read_scene(given)
            known[name] = follow(scene), scene
        return known[name]

    return compute


@pytest.mark.parametrize("name", TRIED)
def test_the_pages_of_the_paper_open(reader, computed, name):
    diagram, scene = computed(name)
    page = reader(diagram, scene)
    assert page.text("h1") == name
    page.choose("#scope", "all")
    assert len(page.all("#table tbody tr")) == len(diagram.entries)
    assert page.all("#diagram .branches path")
    assert page.run("return document.documentElement.scrollWidth <= innerWidth")
    assert page.path.stat().st_size - (FOLDER / LIBRARY).stat().st_size < 2_000_000


def test_basin_fractions_stand_below_the_diagram(reader, computed):
    diagram, scene = computed("fig7")
    shares = [Share(s, "1:1", 0.25, 1) for s in (0.2, 0.5)]
    shares += [Share(s, "2:1", 0.75, 2) for s in (0.2, 0.5)]
    page = reader(diagram, scene, fractions=("s", shares))
    heights = page.run(
        "return [...document.querySelectorAll('#diagram .band')].map(b => b.getBBox().height)"
    )
    assert heights == pytest.approx([17.5, 52.5], abs=0.5)
    names = page.run(
        "return [...document.querySelectorAll('.bands .run-name')].map(t => t.textContent)"
    )
    assert names == ["1:1", "2:1"]
    assert "75 % (0 % to 100 %)" in page.run("return document.querySelector('.band1').textContent")


def test_small_margins_are_shaded_and_margins_are_an_axis(reader, small_margins):
    """Shading reaches from the period doubling one tolerance of s along the stable branch."""
    diagram, scene = small_margins
    (doubling,) = (e for e in diagram.entries if e.kind == "PD")
    page = reader(diagram, scene)
    low, high = page.run(
        "const b = document.querySelector('#diagram .small').getBBox(); return [b.x, b.x + b.width]"
    )
    ticks = page.run(
        "return [...document.querySelectorAll('#diagram g.below .tick')].map(t =>"
        "[+t.textContent, t.transform.baseVal[0].matrix.e])"
    )
    scale = np.polyfit(*np.transpose(ticks), 1)
    span = scene.model.replace(s=0.01)["d"]
    start = doubling.parameters["d"]
    assert [low, high] == pytest.approx(np.polyval(scale, [start, start + span]), abs=0.7)
    key = "return [...document.querySelectorAll('.key text')].map(t => t.textContent)"
    assert "margin below 1" in page.run(key)
    assert not reader(*small_margins, "hide=margin+below+1").all("#diagram .margins path[d*=M]")
    row = int(np.nanargmax(diagram[doubling.branch]["margin"]))
    margin = diagram[doubling.branch]["margin"][row]
    page = reader(*small_margins, f"y=column%3Amargin&at={doubling.branch}:{row}")
    assert "margin (tolerances)" in page.text("#diagram .frames")
    assert f"margin (tolerances){margin:.6g} to PD" in page.text("#orbit-numbers")
    assert page.run("return document.querySelector('#y').selectedOptions[0].text") == (
        "margin (tolerances)"
    )
    page.one("#save-csv").click()
    for one in page.table("points.csv"):
        branch, at = diagram[one["branch"]], int(one["row"])
        assert float(one["value"]) == float(one["margin"]) == branch["margin"][at]
        assert one["margin_event"] == "PD"


def test_attractors_of_no_branch_are_in_the_strip(reader, computed):
    diagram, scene = computed("fig7")
    ends = Bound(0.3, 0.0, None, "the sweep ends"), Bound(0.36, 1e-9, None, "CR[1:1/C|2:1] e7")
    chaos = Motion("1:1/C", None, *ends, 2, [0.31, 0.35], [0.6, 0.7])
    page = reader(diagram, scene, motions=[chaos])
    assert len(page.all("#diagram .run.alone")) == 1
    said = page.run("return document.querySelector('.run.alone').textContent")
    assert said.startswith("1:1/C, simulated, on no branch; impacts at up to 0.7; ends: 0.3:")
    assert "CR[1:1/C|2:1] e7; for d from" in said


def looked_at(driver, page):
    """The diagram as a small grey picture, without its texts: fonts differ."""
    page.run("for (const t of document.querySelectorAll('#diagram text')) t.style.opacity = 0")
    picture = Image.open(io.BytesIO(page.one("#diagram").screenshot_as_png))
    return picture.convert("L").resize((240, 160))


def known(name):
    with Image.open(LOOKED_AT / f"{name}.png") as picture:
        return picture.copy()


def apart(one, other):
    """Mean difference of two grey pictures, of 255."""
    return float(np.mean(np.abs(np.asarray(one, float) - np.asarray(other, float))))


@pytest.mark.parametrize("name", TRIED)
def test_pictures_are_those_that_were_looked_at(reader, driver, computed, tmp_path, name):
    page = reader(*computed(name))
    picture = looked_at(driver, page)
    picture.save(tmp_path / f"{name}.png")
    seen = {one: known(one) for one in TRIED}
    said = f"look at {tmp_path / f'{name}.png'}; if it is right, copy it to {LOOKED_AT}"
    assert apart(picture, seen[name]) < 1.0, said
    assert all(apart(picture, seen[one]) > 2.0 for one in TRIED if one != name)


@pytest.mark.slow
def test_a_hundred_thousand_points_are_drawn_as_few(reader, small, small_scene):
    """What is drawn is bounded by the picture, at any zoom, not by the number of points."""
    branch, rows = small.branches[0], 100_000
    places, known = np.linspace(0, len(branch) - 1, rows), np.arange(len(branch))
    columns = {
        name: np.interp(places, known, values)
        if values.dtype.kind == "f"
        else values[places.round().astype(int)]
        for name, values in branch.columns.items()
    } | {"event": np.full(rows, "", dtype=object)}
    long = dataclasses.replace(branch, columns=columns)
    x, y = columns["d"][rows // 2], columns["v1"][rows // 2]
    middle = f"xlim={x - 0.1},{x + 0.1}&ylim={y - 1},{y + 1}&at=b1:50001"
    page = reader(dataclasses.replace(small, branches=[long]), small_scene, middle)
    size = (
        "return [...document.querySelectorAll('#diagram .branches path')]"
        ".reduce((sum, path) => sum + path.getAttribute('d').length, 0)"
    )
    for _ in range(6):
        assert 100 < page.run(size) < 60_000
        page.keys("#diagram", "+")
    assert "This page holds one orbit of" in page.text("#orbit-missing")


def test_a_ghost_is_clicked_and_shows_its_numbers(reader, small, small_scene):
    page = reader(small, small_scene)
    ghost = next(e for e in small.entries if e.label == "~G[1:1->2:1]")
    page.click_at(f"#diagram [data-entry='{ghost.id}']")
    title = page.one("#orbit-name .set")
    assert title.get_attribute("title") == ghost.label
    assert title.text.split() == ["G\u0303", "1:1", "2:1"] or title.text == "G\u03031:12:1"
    assert ghost.why in page.text("#orbit-state")
    numbers = page.text("#orbit").replace("\u2212", "-")
    assert f"{ghost.value:.12g}"[:11] in numbers
    for impact in ghost.impacts:
        assert f"{impact['velocity']:.12g}"[:10] in numbers
    row = page.one("#table tr[aria-current]")
    assert row.get_attribute("data-entry") == ghost.id
    assert page.all("#series .touch")
    assert page.all("#phase .touch")
    assert len(page.all("#circle .beyond")) == 1
    assert f"at={ghost.id}" in page.fragment()


def test_the_table_is_sorted_filtered_and_linked(reader, small, small_scene):
    page = reader(small, small_scene)
    page.choose("#filter", "~G b1")
    wanted = [e.id for e in small.entries if "~G" in e.label and e.branch == "b1"]
    rows = page.all("#table tbody tr")
    assert [row.get_attribute("data-entry") for row in rows] == wanted
    assert page.text("#count") == f"{len(wanted)} of {len(small.entries)}"
    assert page.all("#diagram .event.faint")
    rows[0].click()
    assert wanted[0] in page.text("#orbit-name")
    page.choose("#filter", "")
    page.choose("#ghosts", "real")
    assert len(page.all("#table tbody tr")) == sum(not e.ghost for e in small.entries)
    page.choose("#ghosts", "all")
    for order, turn in (("ascending", 1), ("descending", -1)):
        page.one("#table th:nth-child(5) button").click()
        head = page.one("#table th:nth-child(5)")
        assert head.get_attribute("aria-sort") == order
        ids = [row.get_attribute("data-entry") for row in page.all("#table tbody tr")]
        values = [turn * small[one].value for one in ids]
        assert values == sorted(values)


def test_the_slider_moves_the_orbit_along_its_branch(reader, small, small_scene):
    page = reader(small, small_scene, "at=b1:5")
    branch, before = (
        small["b1"],
        page.run("return document.querySelector('#phase .path').outerHTML"),
    )
    page.choose("#slider", "9")
    assert f"{branch['d'][9]:.10g}"[:9] in page.text("#orbit-state")
    assert page.run("return document.querySelector('#phase .path').outerHTML") != before
    assert "at=b1%3A9" in page.fragment()


def test_the_unit_circle_is_seen_beside_large_multipliers(reader, small, small_scene):
    """Next to a grazing one is -1e3: it stands at the edge of its picture, with its size."""
    branch = small["b2"]
    row = int(
        np.argmax(np.where(np.isfinite(branch.multipliers[:, 0]), abs(branch.multipliers[:, 0]), 0))
    )
    largest = branch.multipliers[row, 0].real
    assert abs(largest) > 50
    page = reader(small, small_scene, f"at=b2:{row}")
    assert float(page.one("#circle .unit").get_attribute("r")) > 30
    told = page.text("#circle .far text").replace("\u2212", "-")
    assert float(told) == pytest.approx(largest, rel=1e-3)
    frame = page.run(
        "const b = document.querySelector('#circle .beyond').getBBox(),"
        "  s = document.querySelector('#circle').getBoundingClientRect();"
        "return [b.x, b.x + b.width, s.width]"
    )
    assert 60 < frame[0] < frame[1] < frame[2]


def test_the_orbit_plays(reader, small, small_scene):
    page = reader(small, small_scene, "at=b1:5")
    where = "return document.querySelector('#machine .body').getAttribute('transform')"
    before = page.run(where)
    page.one("#play").click()
    time.sleep(0.25)
    assert page.run(where) != before
    page.one("#play").click()
    assert page.one("#play").get_attribute("aria-pressed") == "false"


def test_every_coordinate_is_drawn_and_every_body_moves(reader, masses, masses_scene):
    """The lines in the colours of their names, each beginning where its coordinate is."""
    page, branch = reader(masses, masses_scene, "at=b1:5"), masses["b1"]
    for picture in ("series", "phase"):
        assert len(page.all(f"#{picture} .path")) == 2
        names = [text.text for text in page.all(f"#{picture} .coordinate-name")]
        assert names == ["x1", "x2"]
    where = (
        "return [...document.querySelectorAll('#machine .body')]"
        ".map(body => body.getAttribute('transform'))"
    )
    before = page.run(where)
    page.one("#play").click()
    time.sleep(0.25)
    page.one("#play").click()
    after = page.run(where)
    assert len(before) == len(after) == 2
    assert all(one != other for one, other in zip(before, after, strict=True))
    page.one("#save-motion").click()
    row = page.table("motion.csv")[0]
    assert float(row["displacement x1"]) == pytest.approx(1.0, abs=1e-6)
    assert float(row["displacement x2"]) == pytest.approx(branch["x1_1"][5], abs=1e-6)
    assert float(row["velocity x2"]) == pytest.approx(branch["v1_1"][5], abs=1e-6)


def test_what_was_not_surveyed_is_said_beside_the_stable_runs(reader, small, small_scene):
    page = reader(small, small_scene)
    assert page.text("#survey").startswith("Stable runs: not surveyed: orbits on no followed")
    assert any("follow.depth = 1 was reached" in text for text in small.statistics["notes"])
    done = reader(dataclasses.replace(small, survey="done"), small_scene)
    assert done.text("#survey").startswith("Stable runs: surveyed for the words that were followed")


def test_an_orbit_is_chosen_when_the_page_opens(reader, small, small_scene):
    """A real event in sight, its values on the axis shown; the table and transitions follow."""
    page = reader(small, small_scene)
    chosen = page.one("#table tr[aria-current]").get_attribute("data-entry")
    assert not small[chosen].ghost
    assert page.one("#orbit-shown").is_displayed()
    for name in ("d", "s"):
        page.choose("#x", name)
        value = small[chosen].parameters[name]
        assert f"{name} = {value:.9g}" in page.text("#orbit-state")
        heads = [head.text for head in page.all("#table th")]
        assert [head for head in heads if head in ("d", "s (m)")] == [
            {"s": "s (m)"}.get(name, name)
        ]
        graze = small["e1"].parameters[name]
        assert f"{name} = {graze:.5g}" in page.text("#transitions")


def test_one_menu_hides_what_is_drawn(reader, small, small_scene):
    page = reader(small, small_scene)
    assert not page.one("#toggles").is_displayed()
    page.one("#show summary").click()
    page.one("[data-hides='wall T']").click()
    assert not page.all("#diagram .branch.wall1")
    page.one("h1").click()
    assert not page.one("#toggles").is_displayed()


# Where bodies are: the middle of each one's box, in pixels of the picture.
PLACES = """
const {x, y} = document.querySelector('#machine').getBoundingClientRect();
return [...document.querySelectorAll('#machine .body, #machine .stop')].map(part => {
  const box = part.getBoundingClientRect();
  return [box.x + box.width / 2 - x, box.y + box.height / 2 - y];
});"""


def test_the_capsule_is_drawn_at_its_angle(reader, small, small_scene):
    """With B below, and the ball at B where the orbit begins; as wide as the phase plane."""
    page = reader(small, small_scene, "at=b1:5")
    bottom, top, ball = page.run(PLACES)
    along = np.subtract(bottom, top)
    assert np.arctan2(along[1], along[0]) == pytest.approx(np.pi / 6, abs=0.02)
    assert np.linalg.norm(np.subtract(ball, bottom)) < 0.15 * np.linalg.norm(along)
    sizes = [page.one(f"#{name}").size for name in ("machine", "phase")]
    assert sizes[0]["height"] == sizes[1]["height"]
    assert sizes[0]["width"] == pytest.approx(sizes[1]["width"], abs=2)


def test_a_body_meets_its_stop_when_it_hits(reader, masses, masses_scene):
    page = reader(masses, masses_scene, "at=b1:5")
    boxes = page.run(
        "return ['.body', '.stop'].map(name => {"
        "  const box = document.querySelector(`#machine ${name}`).getBoundingClientRect();"
        "  return [box.left, box.right]; })"
    )
    body, stop = boxes
    assert body[1] == pytest.approx(stop[0], abs=3)


def test_the_keyboard_reaches_everything(reader, small, small_scene):
    page, keys = reader(small, small_scene, "at=b1:5"), webdriver.Keys
    page.keys("#diagram", keys.ARROW_RIGHT)
    assert "at=b1%3A6" in page.fragment()
    page.keys("#diagram", "n")
    first = page.one("#table tr[aria-current]").get_attribute("data-entry")
    page.keys("#diagram", "n")
    assert page.one("#table tr[aria-current]").get_attribute("data-entry") != first
    low, high = page.limits()
    page.keys("#diagram", "+")
    assert page.limits()[1] - page.limits()[0] < high - low
    page.keys("#diagram", "0")
    assert page.limits() == (low, high)
    page.keys("#diagram", keys.ESCAPE)
    assert page.text("#orbit-name") == "Orbit"
    assert page.fragment().endswith("at=")


def test_the_keyboard_zooms_about_the_chosen_point(reader, small, small_scene):
    page = reader(small, small_scene, "at=e1")
    place = small["e1"].parameters["d"]
    for _ in range(6):
        page.keys("#diagram", "+")
    low, high = page.limits()
    assert high - low < 0.01
    assert low - 0.001 < place < high + 0.001
    assert page.all("#diagram .selection")


def test_texts_stay_in_the_picture_and_off_each_other(reader, computed):
    """Also labels of events at its right edge, which lean to the left, and names of orbits."""
    page = reader(*computed("fig7"), "unphysical=all")
    for limits in ((0.05, 0.25), (0.13, 0.2275), (0.1, 0.206), (0.2, 0.24), (0.06, 0.12)):
        page.open(f"unphysical=all&xlim={limits[0]}%2C{limits[1]}&ylim=-0.7%2C0.7")
        corners = page.run(CORNERS, "#diagram")
        assert len(corners) > 20
        inside = page.run("return document.querySelector('#diagram').getBoundingClientRect().width")
        assert all(0 <= x <= inside and y >= 0 for label in corners for x, y in label)
        assert pairs_that_meet(corners) == []


@pytest.mark.parametrize("width", [1400, 500])
def test_no_text_covers_another_in_any_picture(reader, computed, masses, masses_scene, width):
    """Of one and two coordinates, of two parameters, on wide screens and narrow ones."""
    shown = [(computed("fig8"), ""), ((masses, masses_scene), "at=b1:5")]
    shown += [(computed("fig6b"), "view=plane"), (computed("fig6b"), "at=b1:9&y=multiplier")]
    for given, fragment in shown:
        page = reader(*given)
        size = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False}
        page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        page.open(fragment)
        pictures = page.run(
            "return [...document.querySelectorAll('svg[id]')]"
            ".filter(svg => svg.getClientRects().length).map(svg => svg.id)"
        )
        assert pictures == ["plane"] if "plane" in fragment else "machine" in pictures
        for name in pictures:
            corners = page.run(CORNERS, f"#{name}")
            assert pairs_that_meet(corners) == [], (name, fragment)
            wide = page.run("return document.querySelector(arguments[0]).clientWidth", f"#{name}")
            assert all(-1 <= x <= wide + 1 for text in corners for x, _ in text), (name, fragment)
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_notebook_shows_the_page_live(reader, small, small_scene, tmp_path):
    """In a frame, where nothing may write the address: a click on an event moves the orbit."""
    page = reader(small, small_scene)
    inside = view(small, x="d")._repr_html_()
    assert page.complaints() == []
    page.path = tmp_path / "notebook.html"
    page.path.write_text(f"<!DOCTYPE html><p>a cell</p>{inside}", encoding="utf-8")
    page.driver.get(page.path.as_uri())
    page.driver.switch_to.frame(0)
    until = time.monotonic() + 10.0
    while page.run("return document.documentElement.dataset.ready") != "true":
        assert time.monotonic() < until
    event = small.entries[0].id
    assert event not in page.text("#orbit-name")
    page.run("document.querySelector(`#table [data-entry=${arguments[0]}]`).click()", event)
    assert event in page.text("#orbit-name")
    assert page.all("#machine .body")
    time.sleep(0.3)  # when the address would have been written
    page.driver.switch_to.default_content()


def test_infinite_multipliers_are_gaps_of_their_lines(reader, computed):
    """At a zero impact velocity; browsers complain of lines to infinity, and so does the reader."""
    diagram, scene = computed("fig7")
    assert any(np.isinf(branch.multipliers).any() for branch in diagram.branches)
    page = reader(diagram, scene, "y=multiplier&unphysical=all")
    lines = page.run(
        "return [...document.querySelectorAll('#diagram .branch')].map(e => e.getAttribute('d'))"
    )
    assert "".join(filter(None, lines))
    assert not any("Infinity" in (d or "") or "NaN" in (d or "") for d in lines)


def test_the_wheel_zooms_about_the_pointer(reader, small, small_scene):
    page = reader(small, small_scene)
    low, high = page.limits()
    page.run("arguments[0].scrollIntoView({block: 'center'})", page.one("#diagram"))
    wheel = importlib.import_module("selenium.webdriver.common.actions.wheel_input")
    origin = wheel.ScrollOrigin.from_element(page.one("#diagram"))
    webdriver.ActionChains(page.driver).scroll_from_origin(origin, 0, -400).perform()
    assert page.limits()[1] - page.limits()[0] < 0.8 * (high - low)
    assert "xlim=" in page.fragment()


def test_a_fragment_is_restored(reader, small, small_scene):
    cited = "xlim=0.2%2C0.22&ylim=-0.1%2C0.1&hide=wall+T&at=b2%3A3&filter=PD&sort=-s"
    page = reader(small, small_scene, cited)
    low, high = page.limits()
    assert 0.2 <= low < high <= 0.22
    assert not page.all("#diagram .branch.wall1")
    assert page.one("#filter").get_attribute("value") == "PD"
    assert page.text("#orbit-name").startswith("b2")
    restored = page.fragment()
    page.open(restored[1:])
    assert page.fragment() == restored


@pytest.mark.parametrize(
    "fragment",
    [
        "xlim=2,1&at=b99:1&member=7&view=plane&x=toString",
        "at=__proto__&sort=constructor",
        f"filter={SCRIPT}&at=b1:-1&xlim=nan,nan",
        "%E0%A4%A&hide=%00",
    ],
)
def test_a_fragment_that_means_nothing_does_no_harm(reader, small, small_scene, fragment):
    page = reader(small, small_scene)
    first = page.text("#orbit-name")
    page.open(fragment)
    assert page.text("#orbit-name") == first
    assert page.all("#diagram .branches path")


def test_what_is_shown_is_downloaded(reader, small, small_scene):
    page = reader(small, small_scene, "unphysical=none&hide=unstable")
    page.one("#save-svg").click()
    picture = ElementTree.parse(page.downloaded("diagram.svg")).getroot()
    assert {"fill", "stroke"} <= set(picture.find(".//{*}path").attrib)
    assert not [e for e in picture.iter() if "class" in e.attrib or e.tag.endswith("script")]
    page.one("#save-png").click()
    assert page.downloaded("diagram.png").read_bytes().startswith(b"\x89PNG")
    page.one("#save-csv").click()
    rows = page.table("points.csv")
    assert {row["status"] for row in rows} == {"stable"}
    branch = small[rows[0]["branch"]]
    assert float(rows[0]["s"]) == branch["s"][int(rows[0]["row"])]
    assert float(rows[0]["value"]) == branch[rows[0]["line"]][int(rows[0]["row"])]
    page.one("#save-events").click()
    events = page.table("events.csv")
    assert [row["id"] for row in events] == [entry.id for entry in small.entries]
    assert [float(row["s"]) for row in events] == [entry.value for entry in small.entries]


def test_an_orbit_is_downloaded(reader, small, small_scene):
    page, branch = reader(small, small_scene, "at=b1:5"), small["b1"]
    page.one("#save-motion").click()
    rows = page.table("motion.csv")
    assert {row["flight"] for row in rows} == {"1", "2"}
    assert float(rows[0]["displacement"]) == pytest.approx(branch["d"][5] / 2, rel=1e-6)
    assert float(rows[-1]["velocity"]) == pytest.approx(branch["v1"][5], rel=1e-6)
    assert float(rows[-1]["time"]) == pytest.approx(float(rows[0]["time"]) + 1.0, abs=1e-12)
    page.one("[data-saves=phase]").click()
    assert ElementTree.parse(page.downloaded("phase.svg")).getroot().find(".//{*}path") is not None


def test_a_click_on_curves_opens_the_diagram_there(reader, computed):
    diagram, scene = computed("fig6b")
    page = reader(diagram, scene, "view=plane")
    values = sorted({branch["r"][0] for branch in diagram.branches})
    assert len(values) > 1
    assert page.all("#plane .curve")
    marks = page.all("#plane .computed")
    assert len(marks) == len(values)
    webdriver.ActionChains(page.driver).move_to_element(page.one("#plane .point")).perform()
    assert "click: the diagram at r = " in page.text("#plane-hover")
    page.click_at("#plane .computed:last-child")
    assert "view" not in page.fragment()
    assert f"r = {values[-1]:g}" in page.run(
        "return document.querySelector('#member').selectedOptions[0].textContent"
    )


def test_areas_are_tinted_and_told(reader, small_map, small_scene):
    page = reader(small_map, small_scene, "view=plane")
    (area,) = page.all("#plane .area[data-area]")
    assert area.get_attribute("fill") == page.one("#plane .curve").get_attribute("stroke")
    assert "stable until PD" in page.text("#plane .tints")
    webdriver.ActionChains(page.driver).move_to_element(area).perform()
    assert "a1: 1:1 until PD (supercritical), mechanism 3" in page.text("#plane-hover")
    assert "0.3, 0.2: no stable orbit of the scene's words" in page.text("#plane-points")
    assert not page.all("#plane .region")


def test_attractors_are_a_layer(reader, small, small_scene, tmp_path):
    table = tmp_path / "sweep.csv"
    found = sweep(small_scene.model, "s", [0.395, 0.35])
    table.write_text(sweep_text(found), encoding="utf-8")
    page = reader(small, small_scene, "at=a1:0", read_sweep(table, small_scene.model))
    assert page.all("#diagram path.swept")
    assert page.text("#orbit-name") == "attractor 1:1, simulated, s falling"
    assert page.all("#series .path")
    page.run("document.querySelector('[data-hides^=simulated]').click()")
    assert not page.all("#diagram path.swept")


def hostile(small, text):
    """A diagram in which every text is somebody's attempt."""
    entries = [
        dataclasses.replace(e, label=text, why=text, reason=text, notation=text)
        for e in small.branches[0].events
    ]
    reasons = small.branches[0]["reason"].copy()
    reasons[reasons != ""] = text
    columns = {**small.branches[0].columns, "reason": reasons}
    branch = dataclasses.replace(
        small.branches[0],
        events=entries,
        notation=text,
        missed=[text],
        notes=[text],
        columns=columns,
    )
    return dataclasses.replace(small, name=text, branches=[branch])


@pytest.mark.parametrize(
    "text",
    [
        SCRIPT,
        "</script><script>document.title='taken'</script>",
        "<img src=x onerror=alert(1)>",
        "\"'><svg onload=alert(1)>",
        "{{script}}",
        "=1+cmd|' /C calc'!A0",
    ],
)
def test_texts_are_shown_and_nothing_else(reader, small, small_scene, text):
    page = reader(hostile(small, text), small_scene, "at=e1")
    assert page.text("h1") == text
    assert page.run("return document.title") == f"{text} - contimpact"
    assert text in page.text("#warnings")
    assert text[:24] in page.text("#orbit-name")
    assert text in page.text("#table tbody")
    assert len(page.all("script")) == 3
    assert not page.all("img, #table svg, h1 *")
    page.one("#save-events").click()
    events = page.table("events.csv")
    assert events[0]["label"] == (f"'{text}" if text.startswith("=") else text)


def test_it_is_for_everybody(reader, small, small_scene):
    """Names for screen readers, dark and print styles, small screens."""
    page = reader(small, small_scene, "at=e1")
    unnamed = page.run(
        "return [...document.querySelectorAll('button, select, input, svg[role]')].filter("
        "e => !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length))"
        ".map(e => e.outerHTML)"
    )
    assert unnamed == []
    paper = "return getComputedStyle(document.body).backgroundColor"
    emulate = page.driver.execute_cdp_cmd
    light = page.run(paper)
    scheme = {"name": "prefers-color-scheme", "value": "dark"}
    emulate("Emulation.setEmulatedMedia", {"features": [scheme]})
    assert page.run(paper) != light
    emulate("Emulation.setEmulatedMedia", {"media": "print", "features": [scheme]})
    assert page.run(paper) == light
    assert not page.one("#save-svg").is_displayed()
    emulate("Emulation.setEmulatedMedia", {"media": "", "features": []})
    small_screen = {"width": 360, "height": 740, "deviceScaleFactor": 1, "mobile": True}
    emulate("Emulation.setDeviceMetricsOverride", small_screen)
    page.open("at=e1")
    assert page.run("return document.documentElement.scrollWidth") <= 360
    page.run("document.querySelector('#table tbody tr').click()")
    time.sleep(1.0)
    top = page.run("return document.querySelector('#orbit').getBoundingClientRect().top")
    assert 0 <= top < 370
    emulate("Emulation.clearDeviceMetricsOverride", {})
