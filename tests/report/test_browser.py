"""The page of four minutes, in a real browser: opened, played, scrubbed, read. Nothing may be logged or asked for.

It needs Chromium (on Debian: apt-get install chromium) and Playwright, which drives it. Without them it was NOT RUN.
"""

from __future__ import annotations

import cmath
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from soter.record.content import Content
from soter.record.reader import Recording
from soter.report.page.html import make_page
from tests.record.helpers import recorded, rewrite
from tests.report.chromium import NEEDED, looks_wrong, moment, opened, until

pytestmark = NEEDED

DURATION_S = 240.0
MOST_BYTES = 8_000_000
MOST_OPENING_S = 3.0
PHONE = {"width": 390, "height": 844}
NARROW_PHONE = {"width": 360, "height": 740}


SIZES = {390: 844, 820: 1180, 1280: 720, 1920: 1080}
"""Heights of windows by their widths: a phone, a tablet, a laptop, a wide screen."""


class Made(NamedTuple):
    """A page, and what it is of."""

    path: Path
    content: Content


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("pages")
    # Robot 2 has so little charge that it has to drive home.
    recorded(folder / "run.mcap", duration_s=DURATION_S, battery__initial={"2": 0.17})
    recording = Recording(folder / "run.mcap")
    (folder / "run.html").write_text(make_page(recording), encoding="utf-8")
    return Made(folder / "run.html", recording.content())


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Robots that nobody holds back, sent to where they must not go."""
    folder = tmp_path_factory.mktemp("hostile")
    recorded(folder / "run.mcap", duration_s=120.0, targets="hostile", rta__enabled=False)
    recording = Recording(folder / "run.mcap")
    (folder / "run.html").write_text(make_page(recording), encoding="utf-8")
    return Made(folder / "run.html", recording.content())


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A run in which assumptions fail."""
    folder = tmp_path_factory.mktemp("failing")
    fault = {"kind": "bias", "x_m": 0.2, "start_s": 20.0, "declared": False, "robot": 1}
    recorded(folder / "run.mcap", duration_s=60.0, fault=[fault])
    recording = Recording(folder / "run.mcap")
    (folder / "run.html").write_text(make_page(recording), encoding="utf-8")
    return Made(folder / "run.html", recording.content())


def pixel(page: Any, x_m: float, y_m: float) -> tuple[int, int, int]:
    """The colour of a place on the plan."""
    red, green, blue = page.evaluate(
        """([x, y]) => {
            const plan = soter.page.plan;
            const [right, down] = plan.at(x, y).map((each) => Math.round(each * plan.ratio));
            const probe = new OffscreenCanvas(1, 1).getContext("2d", {willReadFrequently: true});
            probe.drawImage(plan.canvas, right, down, 1, 1, 0, 0, 1, 1);
            return [...probe.getImageData(0, 0, 1, 1).data.slice(0, 3)];
        }""",
        [x_m, y_m],
    )
    return red, green, blue


def rgb(colour: str) -> tuple[int, int, int]:
    """A colour of the page's own, in numbers."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def distance(one: tuple[int, int, int], other: tuple[int, int, int]) -> float:
    return math.dist(one, other)


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
    recorded(tmp_path / "run.mcap", duration_s=10.0, ac="adversary:chase")
    (tmp_path / "run.html").write_text(make_page(Recording(tmp_path / "run.mcap")), encoding="utf-8")
    for path, shown in ((made.path, True), (tmp_path / "run.html", False)):
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
                        return soter.page.plan.colour(of(soter.run), of(soter.page.moment).driver);
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


def test_at_its_beginning_a_robot_is_starting(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        assert {each["starting"] for each in moment(page)["robots"]} == {True}
        assert "starting" in page.inner_text("#robots")
        assert "module driving" not in page.inner_text("#robots")
        page.keyboard.press("ArrowRight")
        assert {each["starting"] for each in moment(page)["robots"]} == {False}


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


# --- looks -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_has_both_themes(browser: Any, made: Made, scheme: str) -> None:
    def brightness(page: Any) -> float:
        text = page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(int(each) for each in text[4:-1].split(",")) / 3.0

    with opened(browser, made.path, color_scheme=scheme) as page:
        before = brightness(page)
        assert (before < 60.0) == (scheme == "dark")
        on_plan = pixel(page, 4.0, 4.0)
        page.click("#theme")
        assert (brightness(page) < 60.0) != (before < 60.0)
        assert distance(pixel(page, 4.0, 4.0), on_plan) > 100.0


def test_the_system_decides_about_the_theme_until_somebody_has(browser: Any, made: Made) -> None:
    with opened(browser, made.path, color_scheme="light") as page:
        page.emulate_media(color_scheme="dark")
        until(page, "soter.page.style.dark")
        page.keyboard.press("t")
        assert not page.evaluate("soter.page.style.dark")
        page.emulate_media(color_scheme="light")
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(50)
        assert not page.evaluate("soter.page.style.dark")


def test_it_fits_a_phone_and_scrubs_by_touch(browser: Any, made: Made) -> None:
    with opened(browser, made.path, viewport=PHONE, has_touch=True, is_mobile=True) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        box = page.locator("#scrub").bounding_box()
        page.touchscreen.tap(box["x"] + box["width"] * 0.5, box["y"] + box["height"] / 2)
        assert moment(page)["timeS"] == pytest.approx(DURATION_S / 2, abs=0.05 * DURATION_S)


def test_nothing_leaves_its_place_on_a_narrow_phone(browser: Any, made: Made) -> None:
    beyond = """() => {
        const beyond = (holder, inner, side) => [...document.querySelectorAll(inner)]
            .filter((each) => each.getBoundingClientRect().width && each.getBoundingClientRect()[side] > holder)
            .map((each) => each.outerHTML.slice(0, 80));
        const edge = (name, side, padding) => {
            const holder = document.querySelector(name);
            return holder.getBoundingClientRect()[side] - parseFloat(getComputedStyle(holder)[padding]);
        };
        return [
            ...beyond(edge(".transport", "right", "paddingRight") + 0.5, ".transport *", "right"),
            ...beyond(edge(".table-card", "bottom", "paddingBottom") + 0.5, "#table-scroll", "bottom"),
        ];
    }"""
    with opened(browser, made.path, f"#t={DURATION_S}", viewport=NARROW_PHONE, has_touch=True, is_mobile=True) as page:
        assert moment(page)["timeS"] > DURATION_S - 1.0
        assert page.evaluate(beyond) == []


def test_paper_is_light_and_shows_all_rows(browser: Any, made: Made) -> None:
    with opened(browser, made.path, color_scheme="dark") as page:
        on_screen = pixel(page, 4.0, 4.0)
        page.emulate_media(media="print")
        until(page, "!soter.page.style.dark")
        assert distance(pixel(page, 4.0, 4.0), on_screen) > 100.0
        assert page.evaluate(
            """() => [...document.querySelectorAll("#table-scroll, #robots")]
                .every((each) => each.scrollHeight <= each.clientHeight + 1 && each.clientHeight > 0)"""
        )
        assert len(page.pdf(format="A4")) > 50_000
        page.emulate_media(media="screen")
        until(page, "soter.page.style.dark")
        assert pixel(page, 4.0, 4.0) == on_screen


def test_targets_outside_of_the_fence_are_on_the_plan(browser: Any, hostile: Made) -> None:
    with opened(browser, hostile.path) as page:
        places = page.evaluate(
            """() => soter.run.robots.flatMap((robot) => robot.targets)
                .map(({ xM, yM }) => [...soter.page.plan.at(xM, yM), soter.page.plan.width, soter.page.plan.height])"""
        )
        outside = page.evaluate(
            """() => {
                const [west, south, east, north] = soter.run.workspace.bounds;
                return soter.run.robots.flatMap((robot) => robot.targets)
                    .filter(({ xM, yM }) => xM < west || yM < south || xM > east || yM > north).length;
            }"""
        )
        assert outside > 0
        assert all(0.0 < right < width and 0.0 < down < height for right, down, width, height in places)


def test_everything_that_can_be_used_has_a_name(browser: Any, made: Made) -> None:
    with opened(browser, made.path) as page:
        nameless = page.evaluate(
            """() => [...document.querySelectorAll("button, select, input, canvas:not([aria-hidden])")]
                .filter((each) => !each.getAttribute("aria-label"))
                .filter((each) => each.tagName !== "BUTTON" || !each.textContent.trim())
                .filter((each) => ![...(each.labels || [])].some((label) => label.textContent.trim()))
                .map((each) => each.outerHTML.slice(0, 80))"""
        )
        assert nameless == []
        page.keyboard.press("Tab")
        page.keyboard.press("Tab")
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"


def test_a_moment_can_be_linked_to(browser: Any, made: Made) -> None:
    with opened(browser, made.path, "#t=123.4") as page:
        assert moment(page)["timeS"] == pytest.approx(123.4)
        page.keyboard.press("ArrowRight")
        until(page, "location.hash === '#t=124.4'")
        page.evaluate("location.hash = '#t=10'")
        until(page, "soter.player.timeS === 10")
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.click("#copy-link")
        until(page, "document.getElementById('copied').textContent")
        assert page.inner_text("#copied") in {"link copied", page.url}
        assert page.url.endswith("run.html#t=10")


@pytest.mark.parametrize("width", SIZES)
def test_nothing_overlaps_at_any_size(browser: Any, hostile: Made, width: int) -> None:
    size = {"width": width, "height": SIZES[width]}
    with opened(browser, hostile.path, "#t=60", viewport=size) as page:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            until(page, f"soter.page.style.dark === {str(scheme == 'dark').lower()}")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            plan, player = (page.locator(name).bounding_box() for name in ("#plan", "#transport"))
            assert plan["height"] >= 200.0
            assert plan["y"] + plan["height"] <= player["y"]
            assert looks_wrong(page) == []


def test_a_long_cause_can_be_read_whole_at_any_size(browser: Any, tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", duration_s=90.0, battery__initial={"1": 0.12, "2": 0.12})
    recording = Recording(tmp_path / "run.mcap")
    (tmp_path / "run.html").write_text(make_page(recording), encoding="utf-8")
    switch = max(recording.content().disengagements, key=lambda each: len(each.cause))
    assert len(switch.cause) > 90
    for width, height in SIZES.items():
        size = {"width": width, "height": height}
        with opened(browser, tmp_path / "run.html", f"#t={switch.time_s}", viewport=size) as page:
            why = page.locator(".robot .why").nth(switch.robot_id - 1)
            assert switch.cause in why.inner_text()
            assert why.evaluate("each => each.scrollHeight - each.clientHeight") <= 0
            assert looks_wrong(page) == []


def test_violations_are_the_first_thing_that_one_sees(browser: Any, hostile: Made) -> None:
    violations = hostile.content.violations
    assert violations
    with opened(browser, hostile.path) as page:
        verdict = page.locator("#verdict")
        assert f"{len(violations)} violation" in verdict.inner_text()
        assert "bad" in verdict.get_attribute("class")
        verdict.locator("button").first.click()
        shown = moment(page)
        assert shown["timeS"] == pytest.approx(violations[0].start_s)
        broken = [robot for robot in shown["robots"] if robot["breaks"]]
        assert [robot["id"] for robot in broken] == list(violations[0].robots)
        assert f"breaks {violations[0].rule}" in page.locator("#robots").inner_text()
        # They are on the slider, and keys lead from one to the next.
        red = rgb(page.evaluate("soter.page.style.colours.alarm"))
        found = page.evaluate(
            """(times) => {
                const band = document.getElementById("overview");
                const { firstS, lastS } = soter.run;
                const pixels = band.getContext("2d").getImageData(0, 1, band.width, 1).data;
                const at = (timeS) => 4 * (Math.floor(((timeS - firstS) / (lastS - firstS)) * band.width) + 1);
                return times.map((timeS) => [...pixels.slice(at(timeS), at(timeS) + 3)]);
            }""",
            [each.start_s for each in violations],
        )
        assert all(distance(tuple(each), red) < 10.0 for each in found)
        page.keyboard.press("Home")
        for start_s in sorted({each.start_s for each in violations})[:3]:
            page.keyboard.press("n")
            assert moment(page)["timeS"] == pytest.approx(start_s)


def test_a_recording_that_was_cut_off_says_so(browser: Any, made: Made, tmp_path: Path) -> None:
    whole = made.path.with_name("run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 3])
    path = tmp_path / "cut.html"
    path.write_text(make_page(Recording(tmp_path / "cut.mcap")), encoding="utf-8")
    with opened(browser, path) as page:
        assert "not known" in page.inner_text("#verdict")
        assert "was cut off" in page.inner_text("#notices")
        assert 0.0 < page.evaluate("soter.run.lastS") < DURATION_S / 2.0


def test_a_page_whose_data_are_damaged_says_so(browser: Any, made: Made, tmp_path: Path) -> None:
    text = made.path.read_text(encoding="utf-8")
    at = text.index('id="recording">') + 5000
    broken = tmp_path / "broken.html"
    broken.write_text(text[:at] + text[at + 400 :], encoding="utf-8")
    page = browser.new_page()
    page.goto(broken.as_uri())
    until(page, "document.getElementById('loading').textContent.startsWith('This page cannot be shown')")
    page.close()
