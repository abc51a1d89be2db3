"""The report opened in a browser: everything is drawn, nothing complains, nothing leaves the file."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from rotordx.orchestrator import metrics, report
from tests.report.browser import UNTIL_DRAWN
from tests.report.synthetic import circle_flight

pytestmark = pytest.mark.xdist_group("browser")  # one browser for all

FLIGHT = {"path", "tracking", "rotor-speeds"}
DIAGNOSIS = {"fdie-detection", "fdie-isolation", "fdie-estimation", "fdie-sets"}


def replay_without_truth():
    """What a replay leaves: a diagnoser, what it was fed, no truth, no position."""
    flown = circle_flight(duration=30.0, truth=False)
    kept = {key: values for key, values in flown.signals.items() if key.startswith("fdie.")}
    kept["external.rotor_speed_command"] = flown.signals["controller.rotor_speed_command"]
    return replace(flown, signals=kept, scenario={"log": "flight.csv"})


FLOWN = {
    "fault": (circle_flight, FLIGHT | DIAGNOSIS),
    "healthy": (functools.partial(circle_flight, rotor=None), FLIGHT | {"fdie-detection"}),
    "replay": (replay_without_truth, {"rotor-speeds"} | DIAGNOSIS),
    "two diagnosers": (
        functools.partial(circle_flight, duration=30.0, diagnosers=("fdie", "smo")),
        FLIGHT | DIAGNOSIS | {key.replace("fdie", "smo") for key in DIAGNOSIS},
    ),
    "no diagnoser": (functools.partial(circle_flight, duration=5.0, diagnosers=()), FLIGHT),
}

# How much of each figure is really there: traces, those without any number, lines in the document, pairs of axes.
LOOK = """
Object.fromEntries([...document.querySelectorAll("figure")].map((figure) => {
  const plot = figure.querySelector(".plot");
  return [figure.id, {
    data: plot.data.length,
    empty: plot.data.filter((trace) => ![...trace.y].some(Number.isFinite)).length,
    drawn: [...plot.querySelectorAll("path.js-line")].filter((line) => line.getAttribute("d").length > 20).length,
    axes: plot.querySelectorAll(".cartesianlayer .subplot").length,
  }];
}))
"""

# Number of strongly coloured pixels in an image of the path, which WebGL draws.
COLOURED_PIXELS = """
(async () => {
  const image = new Image();
  const url = await Plotly.toImage(document.querySelector("#path .plot"), { width: 300, height: 300 });
  await new Promise((done) => { image.onload = done; image.src = url; });
  const context = Object.assign(document.createElement("canvas"), { width: 300, height: 300 }).getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, 300, 300);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) {
    const rgb = data.slice(i, i + 3);
    count += data[i + 3] > 100 && Math.max(...rgb) - Math.min(...rgb) > 60;
  }
  return count;
})()
"""


@pytest.fixture
def show(page, tmp_path):
    """Function that opens the report of a recording in the browser."""

    def open_report(recording, **how):
        path = tmp_path / "report.html"
        path.write_text(report.html(recording, metrics.summarise(recording)), encoding="utf-8")
        page.open(path, **how)
        return page

    return open_report


@pytest.fixture
def silent(page):
    """Checks at the end that the page neither complained nor asked for anything but itself."""
    yield
    assert page.problems == []
    outside = [url for url in page.requests if not url.startswith(("data:", "blob:"))]
    assert len(outside) == 1
    assert outside[0].startswith("file:")
    assert outside[0].endswith("report.html")


@pytest.mark.usefixtures("silent")
@pytest.mark.parametrize("name", FLOWN)
def test_every_figure_is_drawn(show, name):
    make, expected = FLOWN[name]
    page = show(make())
    figures = page.run(LOOK)
    assert set(figures) == expected
    for key, figure in figures.items():
        assert figure["data"] > 0, key
        assert figure["empty"] == 0, key
        if key != "path":
            assert figure["axes"] > 0, key
            assert figure["drawn"] >= figure["axes"], key
    if "path" in figures:
        assert page.run(COLOURED_PIXELS) > 100


@pytest.mark.usefixtures("silent")
def test_what_is_asked_for_first_can_be_read_and_looked_at_closely(show):
    page = show(circle_flight())
    header = page.run("document.querySelector('header').innerText")
    assert "Rotor 1 lost 20\xa0% of its thrust at 24.00\xa0s: detected" in header, "no line ends before a unit"
    rows = page.run("[...document.querySelectorAll('tbody th')].map((cell) => cell.innerText)")
    assert rows == list(metrics.MEANING)
    times = np.array(page.run("[...document.querySelector('#fdie-isolation .plot').data[0].x]"))
    assert ((times > 24.05) & (times < 24.25)).sum() >= 60  # of 100 samples


@pytest.mark.usefixtures("silent")
def test_thresholds_are_drawn_on_both_sides_and_altitude_upwards(show):
    page = show(circle_flight(duration=5.0, onset=2.5))
    lower, upper = page.run("[0, 1].map((i) => [...document.querySelector('#fdie-detection .plot').data[i].y])")
    assert min(upper) > 0
    assert lower == [-bound for bound in upper]
    assert page.run("Math.min(...document.querySelector('#path .plot').data[1].z)") > 1.3


@pytest.mark.usefixtures("silent")
def test_zooming_finds_every_peak(show):
    flown = circle_flight(rotor=None)
    residual = flown.signals["fdie.residual"]
    peaks = {1234: 7.0, 15_001: -8.0, 29_998: 9.0}
    for sample, value in peaks.items():
        residual[sample, 1] = value
    page = show(flown)
    for sample, value in peaks.items():
        time = flown.time[sample]
        seen, height = page.run(f"""
          (async () => {{
            const plot = document.querySelector("#fdie-detection .plot");
            await Plotly.relayout(plot, {{ "xaxis.range": [{time - 0.2}, {time + 0.2}], "yaxis2.range": [-10, 10] }});
            const residual = plot.data.find((trace) => trace.name === "residual" && trace.yaxis === "y2");
            const inView = (_, i) => Math.abs(residual.x[i] - {time}) < 0.2;
            const lines = plot.querySelectorAll(".subplot.x2y2 path.js-line");
            return [[...residual.y.filter(inView)], Math.max(...[...lines].map((line) => line.getBBox().height))];
          }})()
        """)
        assert value in seen, f"{value} at {time} s"
        assert height > 112 * abs(value) / 20 * 0.9  # px: the axis of 112 px reaches over 20


@pytest.mark.usefixtures("silent")
def test_light_and_dark_differ_and_follow_the_system(show):
    page = show(circle_flight(duration=30.0), dark=True)
    colour = "document.querySelector('#tracking .ytitle').style.fill"
    dark = page.run(colour)
    assert page.run("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 26)"
    page.run("delete document.documentElement.dataset.drawn")
    page.prefer("light")
    page.run(UNTIL_DRAWN)
    assert page.run("getComputedStyle(document.body).backgroundColor") == "rgb(250, 250, 248)"
    assert page.run(colour) != dark


@pytest.mark.usefixtures("silent")
def test_without_webgl_the_path_is_drawn_from_above(show):
    figure = show(circle_flight(duration=30.0), webgl=False).run(LOOK)["path"]
    assert figure["axes"] == 1
    assert figure["drawn"] == 3  # reference, before and after the fault


@pytest.mark.usefixtures("silent")
def test_the_page_fits_its_window(show):
    page = show(circle_flight(duration=30.0), width=1900)
    for width in (1900, 1000, 400):
        page.resize(width)
        assert page.run("document.documentElement.scrollWidth") == width
        widths = page.run("[...document.querySelectorAll('figure')].map((f) => f.getBoundingClientRect().width)")
        assert min(widths) > 0.4 * min(width, 900)


def test_the_page_could_not_send_anything_if_it_tried(show):
    page = show(circle_flight(duration=5.0, onset=2.5))
    assert page.run("fetch('http://127.0.0.1:9/').then(() => 'sent', () => 'refused')") == "refused"
    assert any("Content Security Policy" in problem for problem in page.problems)
    buttons = page.run("[...document.querySelectorAll('.modebar-btn')].map((b) => b.dataset.title || '')")
    assert not [title for title in buttons if "cloud" in title.lower() or "share" in title.lower()]


@pytest.mark.usefixtures("silent")
def test_a_name_is_shown_and_not_run(show):
    name = '</script><script>window.broken = 1</script><b>"'
    flown = circle_flight(duration=5.0, onset=2.5)
    flown.scenario.update(name=name, note=name)
    flown.faults[0]["profile"] = name
    flown.signals["fdie.residual"][:] = np.inf
    flown.units["fdie.residual"] = flown.descriptions["fdie.residual"] = name
    page = show(flown)
    assert page.run("window.broken") is None
    assert page.run("document.querySelector('h1').innerText").startswith(name)
