"""The page of four minutes, in a real browser: opened, played, scrubbed, read. Nothing may be logged or asked for.

It needs Chromium (on Debian: apt-get install chromium) and Playwright, which drives it. Without them it was NOT RUN.
"""

from __future__ import annotations

import cmath
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from soter.record.reader import Recording
from soter.report.page.html import make_page
from soter.rta import BEGINS_S
from tests.record.helpers import rewrite, standing
from tests.report.chromium import NEEDED, moment, opened, until
from tests.report.pages import DURATION_S, PHONE, Made, distance, page_of, pixel, rgb

pytestmark = NEEDED

MOST_BYTES = 8_000_000
MOST_OPENING_S = 3.0


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A run in which assumptions fail."""
    fault = {"kind": "bias", "x_m": 0.2, "start_s": 20.0, "declared": False, "robot": 1}
    return page_of(tmp_path_factory.mktemp("failing"), duration_s=60.0, fault=[fault])


# --- opening -----------------------------------------------------------------------------------------------


def test_it_opens_quickly_and_is_small(browser: Any, made: Made) -> None:
    assert made.path.stat().st_size < MOST_BYTES * DURATION_S / 7200.0
    with opened(browser, made.path) as page:
        opening_s = page.evaluate("soter.openedMs") / 1000.0
        print(f"\n{made.path.stat().st_size / 1e6:.2f} MB, open after {opening_s:.2f} s")
        assert opening_s < MOST_OPENING_S
        assert page.is_visible("#main")
        assert not page.is_visible("#loading")


def test_a_controllers_page_shows_nothing_of_targets(browser: Any, made: Made, tmp_path: Path) -> None:
    driven = page_of(tmp_path, duration_s=10.0, ac="adversary:chase")
    for path, shown in ((made.path, True), (driven.path, False)):
        with opened(browser, path) as page:
            for part in (".plan", "#figures", "[aria-label='Marks of the time lines']"):
                assert ("target" in page.inner_text(part).lower()) is shown, part
            least, parent = (page.locator(where).bounding_box() for where in (".figure:last-child", "#figures"))
            assert least["x"] + least["width"] == pytest.approx(parent["x"] + parent["width"], abs=1.0)


def test_it_shows_the_figures_of_the_recording(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        assert "No violation" in page.inner_text("#verdict")
        figures = page.inner_text("#figures")
        assert f"{len(made.content.disengagements)}" in figures
        drivers = [each for series in made.content.series.values() for each in series.driver]
        assert f"{100.0 * drivers.count(0) / len(drivers):.1f} %" in figures
        assert page.locator("#rows tr").count() == len(made.content.disengagements)
        about = page.inner_text("#about")
        for expected in ("seed", "4,800 of 0.05 s, 0 dropped", "soter-rta", "kinematic"):
            assert expected in about


def test_assumptions_that_failed_are_named_listed_and_on_the_time_line(browser: Any, made: Made, failing: Made) -> None:
    with opened(browser, made.path) as page:
        assert not page.is_visible("#breaches-card")
    with opened(browser, failing.path) as page:
        assert "A6 of robot 1, 1 look" in page.inner_text("#notices")
        assert page.locator("#breach-rows tr").count() == len(failing.content.breaches) >= 2
        page.locator("#breach-rows tr button").first.click()
        assert moment(page)["timeS"] == pytest.approx(20.0, abs=0.01)
        mark = page.evaluate(
            """() => {
                const lane = soter.page.charts[0];
                const [x, y] = [lane.x(20) + 1, 2].map((each) => Math.round(each * lane.ratio));
                return [...lane.kept.getContext("2d").getImageData(x, y, 1, 1).data.slice(0, 3)];
            }"""
        )
        assert distance(tuple(mark), rgb(page.evaluate("soter.page.style.colours.doubt"))) < 10.0


INK_OF_A_LANE = """(number) => {
    // How many columns of a robot's band, of those in the second half of its time, have ink in them.
    const lane = soter.page.charts[number];
    const { lastS } = soter.run;
    const [left, right] = [lane.x(lastS / 2), lane.x(lastS)].map((each) => Math.round(each * lane.ratio));
    const height = lane.kept.height;
    const { data } = lane.kept.getContext("2d").getImageData(left, 0, right - left, height);
    const ink = soter.page.style.colours.ink.slice(1).match(/../g).map((each) => parseInt(each, 16));
    const middle = Math.round(height / 2) * (right - left);
    let found = 0;
    for (let x = 0; x < right - left; x += 1) {
        const at = 4 * (middle + x);
        if (ink.every((each, channel) => Math.abs(data[at + channel] - each) < 40)) found += 1;
    }
    return found / (right - left);
}"""


def test_robots_that_stood_for_good_are_named_and_hatched_up_to_the_end(
    browser: Any, made: Made, tmp_path: Path
) -> None:
    standing(tmp_path / "run.mcap")
    (tmp_path / "run.html").write_text(make_page(Recording(tmp_path / "run.mcap")), encoding="utf-8")
    with opened(browser, tmp_path / "run.html") as page:
        said = page.inner_text("#notices")
        for robot in (1, 2):
            stood = (
                rf"Robot {robot} was without its AC, and not charging, from 0:00[.0]* to the end of the run: collision"
            )
            assert re.search(stood, said)
            assert page.evaluate(INK_OF_A_LANE, robot - 1) > 0.1
        assert "Never moved: robot 1, 2." in said
        assert ": ." not in said
    with opened(browser, made.path) as page:
        assert "without its AC" not in page.inner_text("#notices")
        assert "Never moved" not in page.inner_text("#notices")
        assert page.evaluate(INK_OF_A_LANE, 0) < 0.02


# --- moving in time ----------------------------------------------------------------------------------------


def test_what_it_draws_is_what_was_recorded(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        for time_s in (0.0, 100.0, 150.0, 239.0):
            page.evaluate("(timeS) => soter.player.seek(timeS)", time_s)
            for robot in moment(page)["robots"]:
                series = made.content.series[robot["id"]]
                index = round(time_s / 0.05)
                assert robot["xM"] == pytest.approx(series.x_m[index], abs=2e-3)
                assert robot["yM"] == pytest.approx(series.y_m[index], abs=2e-3)
                assert robot["driver"] == series.driver[index]
                for margin in robot["margins"]:
                    assert margin["margin"] == pytest.approx(series.margins[margin["name"]][index], abs=1e-3)


def test_a_robot_is_drawn_where_it_is_in_the_colour_of_who_drives_it(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        page.uncheck('[data-layer="marks"]')
        for switch in made.content.disengagements[:20:4]:
            page.evaluate("(timeS) => soter.player.jump(timeS)", switch.time_s)
            for robot in moment(page)["robots"]:
                wanted = page.evaluate(
                    """(id) => {
                        const of = (all) => all.robots.find((each) => each.id === id);
                        return soter.page.style.driving(soter.run, of(soter.run), of(soter.page.moment));
                    }""",
                    robot["id"],
                )  # fmt: skip
                # Around its number, inside of the ring.
                around = (0.065 * cmath.exp(0.25j * math.pi * step) for step in range(8))
                found = [pixel(page, robot["xM"] + each.real, robot["yM"] + each.imag) for each in around]
                assert min(distance(each, rgb(wanted)) for each in found) < 6.0, (switch.time_s, robot["id"])


def test_it_plays_at_its_speed_pauses_and_stops_at_the_end(browser: Any, made: Made) -> None:
    with opened(browser, made.path, still=True) as page:
        page.select_option("#speed", "5")
        before = page.evaluate("soter.page.plan.canvas.toDataURL()")
        page.evaluate("soter.player.seek(60)")
        page.click("#play")
        page.clock.run_for(2000)
        assert page.evaluate("soter.player.timeS") == pytest.approx(70.0, abs=0.2)
        assert page.get_attribute("#play", "aria-label") == "Pause"
        page.click("#play")
        page.clock.run_for(100)
        assert page.get_attribute("#play", "aria-label") == "Play"
        stopped_s = page.evaluate("soter.player.timeS")
        assert page.evaluate("soter.page.plan.canvas.toDataURL()") != before
        page.clock.run_for(500)
        assert page.evaluate("soter.player.timeS") == stopped_s
        page.select_option("#speed", "100")
        page.evaluate("soter.player.seek(soter.run.lastS - 10)")
        page.click("#play")
        page.clock.run_for(1000)
        assert not page.evaluate("soter.player.playing")
        assert page.evaluate("soter.player.timeS") == pytest.approx(made.content.last_s)


def test_scrubbing_moves_the_run(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        for selector in ("#scrub", "#lanes canvas", "#margins canvas"):
            page.evaluate("soter.player.play()")
            place = page.locator(selector).first
            place.scroll_into_view_if_needed()
            box = place.bounding_box()
            down = box["y"] + min(box["height"] / 2, 30)
            page.mouse.move(box["x"] + box["width"] * 0.3, down)
            page.mouse.down()
            page.mouse.move(box["x"] + box["width"] * 0.75, down, steps=4)
            page.mouse.up()
            assert moment(page)["timeS"] == pytest.approx(0.75 * DURATION_S, abs=0.03 * DURATION_S)
            assert not page.evaluate("soter.player.playing")


def test_the_table_jumps_to_a_disengagement(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        switch = made.content.disengagements[7]
        page.locator("#rows tr").nth(7).locator("button").click()
        shown = moment(page)
        assert shown["timeS"] == pytest.approx(switch.time_s)
        robot = next(each for each in shown["robots"] if each["id"] == switch.robot_id)
        assert made.content.drivers[robot["driver"]] == switch.after
        assert robot["cause"]["cause"] == switch.cause
        card = page.locator("#robots article").nth(switch.robot_id - 1).inner_text()
        assert f"{switch.after} module driving" in card
        assert switch.cause in card
        assert page.locator("#rows tr").nth(7).get_attribute("aria-current") == "true"


def test_what_is_under_the_pointer_is_told(browser: Any, made: Made) -> None:
    switch = made.content.disengagements[3]
    with opened(browser, made.path, f"#t={switch.time_s + 1.0}") as page:
        tip = page.locator("#tip")
        robot = next(each for each in moment(page)["robots"] if each["id"] == switch.robot_id)
        hover_plan(page, robot["xM"], robot["yM"])
        words = tip.inner_text()
        assert f"Robot {robot['id']}: " in words
        for margin in robot["margins"]:
            assert margin["name"] in words
        assert f"{robot['margins'][0]['margin']:.3f} m" in words
        page.mouse.move(2, 2)
        assert not tip.is_visible()
        lane = page.locator("#lanes canvas").nth(list(made.content.series).index(switch.robot_id))
        right = page.evaluate("(timeS) => soter.page.charts[0].x(timeS)", switch.time_s) + 0.5
        lane.hover(position={"x": right, "y": 20})
        assert f"{switch.module} module took robot {switch.robot_id} from its AC" in tip.inner_text()
        assert switch.cause in tip.inner_text()
        page.locator("#margins canvas").first.hover(position={"x": right, "y": 20})
        assert "robot 1" in tip.inner_text()
        assert "robot 2" in tip.inner_text()


def hover_plan(page: Any, x_m: float, y_m: float) -> None:
    """Point at a place on the plan."""
    right, down = page.evaluate("([x, y]) => soter.page.plan.at(x, y)", [x_m, y_m])
    page.locator("#plan").hover(position={"x": right, "y": down})


def test_a_tap_tells_of_a_disengagement(browser: Any, made: Made) -> None:
    switch = made.content.disengagements[5]
    with opened(
        browser, made.path, f"#t={switch.time_s + 15.0}", viewport=PHONE, has_touch=True, is_mobile=True
    ) as page:
        moment(page)
        mark = page.evaluate(
            """(timeS) => {
                const { plan, moment } = soter.page;
                const all = soter.run.robots.flatMap((robot) => plan.marksOf(robot, moment.timeS));
                // Robots stand on some of them.
                const places = all.map(({ xM, yM }) => plan.at(xM, yM));
                const [right, down] = places.find((place) => plan.find(...place, moment).mark);
                const box = plan.canvas.getBoundingClientRect();
                return { x: box.left + right, y: box.top + down, found: plan.find(right, down, moment).mark.module };
            }"""
        )
        page.touchscreen.tap(mark["x"], mark["y"])
        assert f"{mark['found']} module took robot" in page.inner_text("#tip")


def test_the_plan_zooms_and_pans(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        at = "(place) => soter.page.plan.at(...place)"
        before = page.evaluate(at, [1.0, 1.0])
        box = page.locator("#plan").bounding_box()
        page.mouse.move(box["x"] + before[0], box["y"] + before[1])
        page.keyboard.down("Control")
        page.mouse.wheel(0, -400)
        page.keyboard.up("Control")
        until(page, "soter.page.plan.zoom > 3")
        # What was under the pointer still is, unless the plan ends there.
        assert page.evaluate(at, [1.0, 1.0]) == pytest.approx(before, abs=30.0)
        west = page.evaluate("soter.page.plan.west")
        page.mouse.down()
        page.mouse.move(box["x"] + before[0] - 80, box["y"] + before[1], steps=3)
        page.mouse.up()
        assert page.evaluate("soter.page.plan.west") > west
        page.click("#zoom-all")
        assert page.evaluate(at, [1.0, 1.0]) == pytest.approx(before)


def test_until_its_ac_has_first_had_it_a_robot_is_starting(browser: Any, made: Made) -> None:
    assert all(series.driver[series.time_s.index(0.9)] != 0 for series in made.content.series.values())
    with opened(browser, made.path) as page:
        for time_s in (0.0, 0.5, 0.9):
            page.evaluate("(timeS) => soter.player.seek(timeS)", time_s)
            assert {each["starting"] for each in moment(page)["robots"]} == {True}
            assert "starting" in page.inner_text("#robots")
            assert "module" not in page.inner_text("#robots")
        first = "soter.page.style.driving(soter.run, soter.run.robots[0], soter.run.robots[0].stretches[0])"
        assert page.evaluate(f"{first} === soter.page.style.colours.soft")
        page.evaluate("(timeS) => soter.player.seek(timeS)", BEGINS_S)
        assert {each["starting"] for each in moment(page)["robots"]} == {False}
        assert "starting" not in page.inner_text("#robots")


def test_the_table_can_be_narrowed(browser: Any, made: Made) -> None:
    every = made.content.disengagements
    robot_id, module = every[0].robot_id, every[0].module
    wanted = [each for each in every if (each.robot_id, each.module) == (robot_id, module)]
    assert len(wanted) < len(every)
    with opened(browser, made.path) as page:
        page.select_option("#filter-robot", str(robot_id))
        page.select_option("#filter-module", module)
        assert page.locator("#rows tr").count() == len(wanted)


def test_a_robot_that_the_supervisor_took_is_counted_and_found(browser: Any, made: Made, tmp_path: Path) -> None:
    def edit(topic: str, data: bytes) -> bytes:
        switch = json.loads(data)
        if topic == "/switches" and switch["before"] == "AC" and switch["module"] == "obstacle":
            return json.dumps({**switch, "module": "supervisor"}).encode()
        return data

    rewrite(made.path.with_name("run.mcap"), tmp_path / "run.mcap", edit)
    path = tmp_path / "run.html"
    path.write_text(make_page(Recording(tmp_path / "run.mcap")), encoding="utf-8")
    taken = sum(each.module == "obstacle" for each in made.content.disengagements)
    with opened(browser, path) as page:
        assert f"supervisor {taken}" in page.inner_text("#figures")
        page.select_option("#filter-module", "supervisor")
        assert page.locator("#rows tr").count() == taken > 0


def test_the_playback_is_reached_without_passing_every_row(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        page.keyboard.press("Tab")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        until(page, "document.activeElement.id === 'play'")
        page.keyboard.press("Space")
        assert page.evaluate("soter.player.playing")


def test_keys(browser: Any, made: Made) -> None:
    first, second = (each.time_s for each in made.content.disengagements[:2])
    with opened(browser, made.path) as page:
        for key, wanted in (
            ("ArrowRight", 1.0), ("Shift+ArrowRight", 11.0), ("ArrowLeft", 10.0), ("Home", 0.0),
            ("n", first), ("n", second), ("p", first), ("End", made.content.last_s),
        ):  # fmt: skip
            page.keyboard.press(key)
            assert moment(page)["timeS"] == pytest.approx(wanted), key
        page.keyboard.press("+")
        assert page.evaluate("soter.player.speed") == 20
        page.keyboard.press("-")
        assert page.evaluate("soter.player.speed") == 10
        page.keyboard.press("Space")
        assert page.evaluate("soter.player.playing")
        page.keyboard.press("Space")
        page.keyboard.press("?")
        assert page.is_visible("#help")
        page.keyboard.press("Escape")
        assert not page.is_visible("#help")
