"""The page of a diagram in which an orbit has no impacts."""

from contimpact import Oscillator, continue_orbit, find_orbits
from contimpact.page.data import PageView, page_data
from contimpact.results.diagram import Diagram


def test_orbits_without_impacts_have_no_flights():
    model = Oscillator(a=0.05, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8)
    branch = continue_orbit(find_orbits(model, "0", parameter="a")[0], "a", range=(0.04, 0.06))
    (record,) = page_data(Diagram("quiet", [branch]), model, PageView("a"))["branches"]
    assert record["tracks"]["nodes"] == []
