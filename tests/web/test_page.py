"""The map page as people use it: with a mouse, with the keyboard alone, on a phone, in the dark."""

import re
from datetime import datetime, timedelta
from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import expect

FROM, TO = "24.941400,60.171900", "24.948000,60.165500"
ROUTE = f"#from={FROM}&to={TO}&at=Sat-17:30"
TABS = ("routes", "leave", "reach", "walk", "crowds")
FREE = """() => {
  const of = (part) => document.querySelector(part).getBoundingClientRect();
  const [map, time, panel] = [of("#map"), of(".time"), of("#panel")];
  const wide = innerWidth >= 800;
  return { left: map.left, right: map.right, top: wide ? map.top : time.bottom, bottom: wide ? time.top : panel.top };
}"""
"""The part of the map that neither the panel nor the bar of time covers."""
DRAWN = "(layer) => sidestep.map.queryRenderedFeatures({ layers: [layer] }).map(({ properties }) => properties)"
CAMERA = "() => [...sidestep.map.getCenter().toArray(), sidestep.map.getZoom()]"
VIOLATIONS = """async (options) => (await axe.run(options)).violations.map(({ id, impact, nodes }) =>
  [id, impact, nodes.map(({ target, failureSummary }) => `${target.join(" ")}: ${failureSummary}`)])"""
COLOURS = {"runOnly": ["color-contrast", "link-in-text-block"]}
"""All that the dark theme changes."""
SMALL = """() =>
  [...document.querySelectorAll("button, select, input:not([type=checkbox]), summary, .planners label")]
    .filter((node) => node.checkVisibility())
    .map((node) => [node.id || node.className, node.getBoundingClientRect()])
    .filter(([, box]) => box.width > 1 && (box.height < 43.5 || box.width < 43.5))
    .map(([name, box]) => `${name}: ${box.width} by ${box.height}`)"""
BOTH = pytest.mark.parametrize("size", ["desktop", "phone"])


def click_map(view, share_x: float, share_y: float) -> None:
    """Click a point of the map that neither the panel nor the bar of time covers."""
    box = view.get(FREE)
    x = box["left"] + share_x * (box["right"] - box["left"])
    y = box["top"] + share_y * (box["bottom"] - box["top"])
    view.page.mouse.click(x, y)


def drawn(view, layer: str) -> list[dict]:
    """What a layer of the map shows."""
    return view.get(DRAWN, layer)


def tab_to(view, name: str) -> None:
    """Go on from control to control until one has the focus."""
    for _ in range(40):
        if view.get("() => document.activeElement.id") == name:
            return
        view.page.keyboard.press("Tab")
    pytest.fail(f"{name} is not reached")


def first_row(view):
    return view.page.locator("#routes-body tr").first


@BOTH
def test_two_clicks_on_the_map_draw_a_route(opened, size):
    view = opened(size).open("#at=Sat-17:30")
    expect(view.page.locator("#hint")).to_have_text(re.compile("(Click|Tap) the map where the walk begins"))
    click_map(view, 0.45, 0.35)
    expect(view.page.locator("#hint")).to_have_text(re.compile("the map where the walk ends"))
    click_map(view, 0.55, 0.65)
    view.until(lambda: "expected" in {each["planner"] for each in drawn(view, "routes")})
    if size == "phone":
        expect(view.page.locator("#summary")).to_contain_text("min")
    view.page.click("#tab-routes")
    expect(first_row(view)).to_contain_text(re.compile(r"expected.*\d+.*\d"))
    view.until(lambda: "from=24." in view.page.url and "to=24." in view.page.url)
    minutes, _, people = (
        float(re.split(r"[^\d.]", cell.replace(",", ""))[0]) for cell in first_row(view).locator("td").all_inner_texts()
    )
    assert 1 < minutes < 60 < people


def test_the_sheet_leaves_the_route_in_sight(opened):
    view = opened("phone", reduced_motion="no-preference").open(ROUTE)
    view.until(lambda: drawn(view, "routes"))
    view.page.click("#tab-routes")  # which raises the sheet to half of the screen

    def in_sight() -> bool:
        free, boxes = view.get(FREE), [view.page.locator(f".pin-{end}").bounding_box() for end in ("from", "to")]
        return all(free["top"] <= box["y"] and box["y"] + box["height"] <= free["bottom"] for box in boxes)

    view.until(in_sight)
    expect(view.page.locator("#panel")).to_have_attribute("data-sheet", "half")


def test_what_is_shown_beside_a_raised_sheet_is_not_tiny(opened):
    view = opened("phone", reduced_motion="reduce").open(f"#from={FROM}&to={TO}&at=Sat-17:30")
    view.page.click("#tab-reach")
    expect(view.page.locator("#reach-found tbody tr")).to_have_count(3, timeout=60000)
    view.until(lambda: drawn(view, "reach-area"))
    view.page.click("#sheet")  # as high as it goes
    expect(view.page.locator("#panel")).to_have_attribute("data-sheet", "high")
    assert view.get(CAMERA)[2] > 11.5  # which still shows the area that one reaches
    view.page.click("#tab-walk")
    view.page.click("#walk-start")
    expect(view.page.locator("#walk-log li").first).to_be_visible(timeout=60000)
    view.page.click("#sheet")
    view.until(lambda: view.get(CAMERA)[2] > 14)  # the walk is framed again


def test_the_hint_stands_below_the_time(opened):
    view = opened("phone").open("#at=Sat-17:30&tab=crowds")
    expect(view.page.locator("#mark-sensor")).to_be_visible()  # which makes the card of the time higher
    time, hint = (view.page.locator(part).bounding_box() for part in (".time", "#hint"))
    assert hint["y"] >= time["y"] + time["height"]


@BOTH
def test_the_slider_changes_the_colours_of_streets(opened, size):
    view = opened(size).open("#at=Sat-04:00")
    view.until(lambda: 0 < sum(view.classes()) < 1000)
    before, shown = view.classes(), view.page.screenshot()
    view.page.locator("#slider").fill("1050")
    expect(view.page.locator("#time-shown")).to_have_text("Saturday 17:30")
    view.until(lambda: view.classes().count(3) > 100)
    changed = sum(one != other for one, other in zip(before, view.classes(), strict=True))
    assert changed > 1000

    def jammed(picture: bytes) -> int:
        pixels = np.asarray(Image.open(BytesIO(picture)).convert("RGB")).astype(int)
        return int((np.abs(pixels - (0x7A, 0x10, 0x38)).max(axis=-1) < 12).sum())

    legend = jammed(shown)
    view.until(lambda: jammed(view.page.screenshot()) > 2 * legend + 200)


def test_playing_goes_through_the_day_and_stops(opened):
    view = opened(reduced_motion="reduce").open("#at=Sat-16:30")
    view.page.click("#play")
    expect(view.page.locator("#play")).to_have_attribute("aria-label", "Stop")
    expect(view.page.locator("#time-shown")).to_have_text("Saturday 17:00", timeout=8000)
    view.page.click("#play")
    expect(view.page.locator("#play")).to_have_attribute("aria-label", "Play the day")


def test_planners_alternatives_and_directions(opened):
    view = opened().open(ROUTE)
    rows = view.page.locator("#routes-body tr")
    view.until(lambda: {each["planner"] for each in drawn(view, "routes")} == {"expected", "shortest-path"}, 60)
    expect(rows.filter(has_text="Another way").first).to_be_visible(timeout=60000)
    expect(rows.filter(has_text="9 in 10").first).to_be_visible()
    rows.filter(has_text="Another way").get_by_role("button").first.click()
    expect(view.page.locator("#directions h2")).to_contain_text("another way 1")
    expect(view.page.locator("#directions li").last).to_contain_text("Arrive")
    way = view.page.get_by_role("button", name="shortest-path")
    way.focus()
    view.page.keyboard.press("Enter")
    expect(view.page.locator("#directions h2")).to_have_text("Turn by turn, shortest-path")
    expect(way).to_be_focused()
    box = view.page.get_by_role("checkbox", name="shortest-path")
    expect(box).to_be_checked()  # to look at a way does not take it away
    box.uncheck()
    view.until(lambda: "shortest-path" not in {each["planner"] for each in drawn(view, "routes")})
    view.until(lambda: "planners=expected&" in view.page.url)
    view.page.get_by_role("button", name="More planners").click()
    expect(view.page.get_by_role("checkbox", name="random-walk")).to_be_visible()
    rows.filter(has_text="greedy-map").click()
    expect(view.page.get_by_role("checkbox", name="greedy-map")).to_be_checked()
    expect(view.page.locator("#directions h2")).to_have_text("Turn by turn, greedy-map", timeout=60000)


def test_a_busy_server_is_asked_by_two_planners_at_a_time_and_again(opened):
    view = opened(allowed=("status of 429", "status of 503"))
    held, refused = [], set()

    def busy(route) -> None:
        """Hold the first questions, then refuse every one once, as the server does when it has too much to do."""
        if not refused and len(held) < 2:
            held.append(route)
        elif (url := route.request.url) in refused:
            route.fallback()
        else:
            refused.add(url)
            route.fulfill(
                status=503 if len(refused) % 2 else 429, headers={"retry-after": "1"}, json={"detail": "busy"}
            )

    view.page.route("**/route/v1/foot/**", busy)
    planners = ["expected", "shortest-path", "greedy-map", "snapshot", "random-progress"]
    view.open(f"{ROUTE}&planners={','.join(planners)}")
    rows = view.page.locator("#routes-body tr[aria-busy]")
    expect(rows.filter(has_text="planning")).to_have_count(2)
    expect(rows.filter(has_text="waiting")).to_have_count(3)
    assert (len(held), refused) == (2, set())
    for route in held:
        busy(route)
    expect(view.page.locator("#panel-routes")).to_have_attribute("aria-busy", "false", timeout=120000)
    expect(view.page.locator("#routes-body").get_by_text("no answer")).to_have_count(0)
    expect(view.page.locator("#alert")).to_be_hidden()
    assert {each["planner"] for each in drawn(view, "routes")} == set(planners)


def test_numbers_of_another_question_are_not_shown(opened):
    view = opened().open(ROUTE)
    rows = view.page.locator("#routes-body tr")
    expect(rows.filter(has_text="9 in 10")).not_to_have_count(0, timeout=60000)
    expect(view.page.locator("#panel-routes")).to_have_attribute("aria-busy", "false")
    view.page.route("**/route/v1/foot/**", lambda _: None)  # an answer that takes long
    view.page.locator("#slider").fill("240")
    expect(view.page.locator("#panel-routes")).to_have_attribute("aria-busy", "true")
    expect(view.page.locator("#routes-status")).to_have_text("Planning routes")
    expect(rows.filter(has_text="planning")).to_have_count(2)
    assert not re.search(r"\d", view.page.locator("#routes-body").inner_text())
    expect(view.page.locator("#directions")).to_be_empty()
    expect(view.page.locator("#summary")).not_to_contain_text("min")
    view.page.locator("#slider").fill("1050")  # back at what was asked first, for which there are numbers
    expect(first_row(view)).to_contain_text(re.compile(r"expected.*\d", re.DOTALL))
    expect(first_row(view)).to_have_attribute("aria-busy", "true")


@BOTH
def test_large_numbers_stay_in_their_columns(opened, size):
    view = opened(size)

    def crowded(route) -> None:
        answer = route.fetch()
        said = answer.json()
        for turn, each in enumerate(said["routes"]):
            each |= {"people_met": 98_765 * 40**turn, "distance": 98_765, "duration": 60_000}
        route.fulfill(response=answer, json=said)

    view.page.route("**/route/v1/foot/**", crowded)
    view.open(f"{ROUTE}&planners=expected")
    view.page.click("#tab-routes")
    expect(view.page.locator("#routes-body").get_by_text("98.8K").first).to_be_visible()
    expect(view.page.locator("#routes-body").get_by_text("3.95M")).to_be_visible(timeout=60000)
    wide = """() => [...document.querySelectorAll("#routes-body td")]
      .filter((cell) => cell.scrollWidth > cell.clientWidth || cell.getBoundingClientRect().right > innerWidth)
      .map((cell) => cell.textContent)"""
    assert view.get(wide) == []


def test_the_best_time_to_leave(opened):
    view = opened().open(f"{ROUTE}&tab=leave")
    expect(view.page.locator(".curve")).to_be_visible(timeout=60000)
    expect(view.page.locator("#leave-found .finding")).to_contain_text("nine walks in ten")
    view.page.get_by_text("As a table").click()
    rows = view.page.locator(".departures tbody tr")
    assert rows.count() == 13
    rows.nth(6).get_by_role("button").click()
    expect(view.page.locator("#time-shown")).to_have_text("Saturday 18:30")
    view.page.fill("#leave-by", "19:00")
    expect(view.page.locator("#leave-by-day")).to_have_text("Saturday")
    expect(view.page.locator(".departures thead")).to_contain_text("there by Sat 19:00", timeout=60000)
    view.until(lambda: "by=19:00" in view.page.url)
    view.page.fill("#leave-by", "09:00")  # which is past
    expect(view.page.locator("#leave-by-day")).to_have_text("Sunday, the next day")
    expect(view.page.locator(".departures thead")).to_contain_text("there by Sun 09:00", timeout=60000)


def test_a_route_that_arrives_by_a_time(opened):
    view = opened().open(f"{ROUTE}&planners=expected")
    expect(first_row(view)).to_contain_text(re.compile(r"expected.*\d", re.DOTALL))
    view.page.fill("#arrive-by", "18:30")
    expect(first_row(view)).to_contain_text("leave 18:1", timeout=60000)
    view.until(lambda: "by=18:30" in view.page.url)
    other = opened().open(f"#{view.page.url.partition('#')[2]}")
    expect(other.page.locator("#arrive-by")).to_have_value("18:30")


def test_areas_are_avoided_and_stand_in_the_link(opened):
    view = opened().open(f"{ROUTE}&planners=expected")
    keyboard = view.page.keyboard
    view.until(lambda: drawn(view, "routes"))
    way = "() => sidestep.map.getSource('routes').serialize().data.features[0].geometry.coordinates"
    before = view.get(way)
    view.page.get_by_text("Areas to avoid", exact=True).focus()
    keyboard.press("Enter")
    tab_to(view, "end-avoid")
    longitude, latitude = before[len(before) // 2]
    keyboard.type(f"{latitude} {longitude}")
    keyboard.press("Enter")
    view.until(lambda: "avoid=" in view.page.url)
    expect(view.page.locator("#mark-avoid")).to_be_visible()
    view.until(lambda: view.get(way) != before, 60)
    near = [np.hypot((x - longitude) * 55_300, (y - latitude) * 111_195) for x, y in view.get(way)]
    assert min(near) > 55
    other = opened().open(f"#{view.page.url.partition('#')[2]}")
    expect(other.page.locator(".areas select")).to_have_value("60")
    view.until(lambda: drawn(view, "avoid-area"))
    view.page.get_by_role("button", name="no more").click()
    view.until(lambda: view.get(way) == before)
    view.until(lambda: "avoid=" not in view.page.url)


def test_all_of_a_street_is_avoided_but_may_be_crossed(opened):
    view = opened(allowed=("status of 4",)).open(
        "#from=24.936,60.1715&to=24.9445,60.1658&at=Sat-17:30&planners=shortest-path"
    )
    steps = view.page.locator("#directions li")
    expect(steps.filter(has_text="Mannerheimintie").first).to_be_visible()
    view.page.get_by_text("Areas to avoid", exact=True).click()
    box = view.page.locator("#end-avoid")
    box.fill("mannerheimint")
    box.press("Enter")
    expect(view.page.locator(".areas li")).to_contain_text("Mannerheimintie")
    view.until(lambda: "avoid=street:Mannerheimintie&" in view.page.url)
    expect(steps.last).to_contain_text("Arrive", timeout=60000)
    expect(steps.filter(has_text="Mannerheimintie")).to_have_count(0)
    other = opened().open(f"#{view.page.url.partition('#')[2]}")
    expect(other.page.locator("#directions li").last).to_contain_text("Arrive", timeout=60000)
    expect(other.page.locator("#directions li").filter(has_text="Mannerheimintie")).to_have_count(0)
    view.until(lambda: drawn(other, "avoid-area"))
    other.get("(link) => { location.hash = link; }", f"#from={FROM}&to={TO}&avoid=street:Nowhere")
    expect(other.page.locator("#alert-says")).to_contain_text("Nowhere")


def test_departures_reach_and_walks_keep_out_of_areas(opened):
    def answer(tab: str, path: str, avoid: str) -> dict:
        view = opened()
        with view.page.expect_response(lambda response: response.url.endswith(path), timeout=60000) as response:
            view.open(f"{ROUTE}&tab={tab}{avoid}")
            if tab == "walk":
                view.page.click("#walk-start")
        assert ("avoid" in response.value.request.post_data_json) == bool(avoid)
        found = response.value.json()
        view.page.close()  # browsers keep six connections to a server, and listening takes two
        return found

    def away(walk: dict) -> float:
        """Metres from the middle of the area to the nearest point of a walk."""
        line = walk["route"]["geometry"]["coordinates"]
        return min(np.hypot((x - longitude) * 55_300, (y - latitude) * 111_195) for x, y in line)

    free = answer("walk", "/walks", "")
    line = free["route"]["geometry"]["coordinates"]
    longitude, latitude = line[len(line) // 2]
    avoid = f"&avoid={longitude},{latitude},60"
    assert away(answer("walk", "/walks", avoid)) > 55 > away(free)
    assert "id" in answer("walk", "/walks", "&avoid=street:Unioninkatu")  # which has the most parts of all streets

    def soonest(found: dict) -> float:
        return min(each["median_minutes"] for each in found["departures"])

    assert soonest(answer("leave", "/when", avoid)) > soonest(answer("leave", "/when", ""))

    def kilometres(found: dict) -> float:
        return max(each["properties"].get("kilometres", 0.0) for each in found["features"])

    assert kilometres(answer("reach", "/isochrone", avoid)) < kilometres(answer("reach", "/isochrone", ""))


def test_how_far_one_gets(opened):
    view = opened().open(f"#from={FROM}&at=Sat-17:30&tab=reach")
    expect(view.page.locator("#reach-found tbody tr")).to_have_count(3, timeout=60000)
    view.until(lambda: {each["minutes"] for each in drawn(view, "reach-area")} == {5, 10, 15})
    view.page.click("#tab-routes")
    view.until(lambda: drawn(view, "reach-area") == [])


def test_a_walk_is_played_and_planned_anew(opened):
    view = opened(reduced_motion="reduce").open(f"{ROUTE}&tab=walk")
    view.page.select_option("#walk-speed", "120")
    view.page.click("#walk-start")
    log = view.page.locator("#walk-log li")
    expect(log.nth(3)).to_be_visible(timeout=60000)
    for _ in range(8):  # crowds on streets without another way change nothing
        if view.page.locator("#walk-log .changed").count():
            break
        view.page.locator("#walk-crowd").click()
        view.until(lambda: view.page.locator("#walk-crowd").get_attribute("aria-pressed") == "false")
    expect(view.page.locator("#walk-log .changed").first).to_contain_text("The plan changed.")
    view.until(lambda: "walked" in {each["part"] for each in drawn(view, "walk")})
    expect(view.page.locator("#walk-log .arrived")).to_be_visible(timeout=60000)
    expect(view.page.locator("#walk-says")).to_contain_text("Arrived at")


@BOTH
def test_a_posted_count_appears_and_changes_streets(opened, server, size):
    view = opened(size).open("#tab=crowds")
    expect(view.page.locator("#wire")).to_have_text("live")
    sensors = server.ask("/sensors")["features"]
    names = sorted(each["properties"]["sensor"] for each in sensors)
    assert len(names) == len(set(names)) == server.ask("/town")["sensors"]
    name = names[0 if size == "desktop" else 1]
    view.until(lambda: len(view.classes()) > 0)
    before, now = view.classes(), datetime.fromisoformat(server.ask("/clock")["now"])
    began, count = now - timedelta(minutes=61), 6000 if size == "desktop" else 5000
    said = server.send("/counts", {"sensor": name, "time": began.isoformat(), "count": count})
    assert said["new"] == 1
    # The first counts of a server have programs compiled.
    expect(view.page.locator(".toast")).to_contain_text(name, timeout=60000)
    view.until(lambda: view.classes() != before)
    expect(view.page.locator("#crowds-kind")).to_contain_text("live")
    row = view.page.locator("#sensors-body tr").filter(has_text=name)
    expect(row.locator("td").first).to_have_text(f"{count:,}")
    expect(view.page.locator("#mark-sensor")).to_be_visible()
    assert sum(each["sensor"] == name for each in drawn(view, "sensors")) == 1


def test_what_is_said_of_a_street_follows_the_time(opened):
    view = opened(allowed=("Failed to load",)).open(f"{ROUTE}&planners=expected&tab=crowds")
    view.until(lambda: drawn(view, "streets"))
    expect(view.page.locator("#densest-body tr")).to_have_count(10)
    spot = view.get("""() => {
      const street = sidestep.map.queryRenderedFeatures([[600, 300], [1200, 600]], { layers: ["streets"] })[0];
      const { x, y } = sidestep.map.project(street.geometry.coordinates.flat(Infinity).slice(0, 2));
      const map = document.querySelector("#map").getBoundingClientRect();
      return [x + map.left, y + map.top];
    }""")
    view.page.mouse.click(*spot)
    crowd = view.page.locator("#here-crowd")
    expect(crowd).to_contain_text("persons/m²")
    before = crowd.inner_text()
    view.page.locator("#slider").fill("240")
    expect(crowd).not_to_have_text(before)
    expect(crowd).to_contain_text("persons/m²")
    view.page.route("**/crowds?*", lambda route: route.abort())
    view.page.select_option("#day", "2")  # of which nothing is known yet
    expect(crowd).to_have_text("…")
    expect(view.page.locator("#densest-body")).to_be_hidden()


def test_now_goes_on_without_counts(opened):
    view = opened(alone=True)
    view.page.clock.install()
    view.open("#tab=crowds")
    expect(view.page.locator("#wire")).to_have_text("live")
    asked = len([url for url in view.requested if "crowds?" in url and "at=" not in url])
    view.page.clock.fast_forward("16:00")
    view.until(lambda: len([url for url in view.requested if "crowds?" in url and "at=" not in url]) > asked)


def test_a_route_with_the_keyboard_alone(opened):
    view = opened().open("#at=Sat-17:30")
    keyboard = view.page.keyboard
    keyboard.press("Tab")
    expect(view.page.locator(".skip")).to_be_focused()
    keyboard.press("Enter")
    tab_to(view, "end-from")
    keyboard.insert_text("kaivok")  # at once: what is listed is then for all of it
    expect(view.page.get_by_role("option").first).to_contain_text("Kaivokatu")
    keyboard.press("ArrowDown")
    active = view.page.locator("#end-from").get_attribute("aria-activedescendant")
    expect(view.page.locator(f"#{active}")).to_have_attribute("aria-selected", "true")
    view.until(lambda: {each["name"] for each in drawn(view, "found")} == {"Kaivokatu"})
    keyboard.press("Enter")
    expect(view.page.locator("#end-from")).to_have_value("Kaivokatu")
    tab_to(view, "end-to")
    keyboard.type("60.1655 24.9480")
    expect(view.page.get_by_role("option").first).to_contain_text("60.16550, 24.94800")
    keyboard.press("Enter")
    expect(first_row(view)).to_contain_text(re.compile(r"\d+"))
    view.until(lambda: drawn(view, "routes"))
    tab_to(view, "tab-routes")
    keyboard.press("ArrowRight")
    expect(view.page.locator("#tab-leave")).to_be_focused()
    expect(view.page.locator("#panel-leave")).to_be_visible()
    # The destination is moved by arrow keys, too.
    view.page.locator(".pin-to").focus()
    link = view.page.url
    keyboard.press("ArrowUp")
    view.until(lambda: view.page.url != link)


def test_enter_takes_what_is_typed_and_not_what_was_found_before(opened):
    view = opened().open("#at=Sat-17:30")
    box = view.page.locator("#end-from")
    box.fill("kaivok")
    expect(view.page.get_by_role("option").first).to_contain_text("Kaivokatu")
    box.fill("bulevar")
    box.press("Enter")
    expect(box).to_have_value("Bulevardi")
    view.page.wait_for_timeout(400)  # what was still to be looked for does not open the list again
    expect(box).to_have_attribute("aria-expanded", "false")
    expect(view.page.locator("#alert")).to_be_hidden()


def test_a_street_that_is_not_there_is_not_taken(opened):
    view = opened().open(f"{ROUTE}&planners=expected")
    ends = "() => JSON.stringify([sidestep.state.from, sidestep.state.to].map(({ lon, lat }) => [lon, lat]))"
    before, box = view.get(ends), view.page.locator("#end-to")
    box.fill("no such street")
    box.press("Enter")
    said = view.page.locator("#alert-says")
    expect(said).to_contain_text(re.compile("no such street.*ends at Kasarmitori"))  # whose pin and route still stand
    view.page.click("#alert-close")
    box.fill("no such street")
    box.press("Enter")
    expect(said).to_contain_text("no such street")
    assert view.get(ends) == before
    box.fill("kaivok")
    expect(view.page.locator("#alert")).to_be_hidden()
    expect(view.page.get_by_role("option").first).to_contain_text("Kaivokatu")
    box.fill("nowhere")
    expect(view.page.get_by_role("option").first).to_contain_text("No street")
    box.press("Tab")  # which takes nothing, and leaves what was there
    expect(said).to_contain_text(re.compile("nowhere.*ends at Kasarmitori"))
    expect(box).to_have_value("Kasarmitori")
    assert view.get(ends) == before


def test_the_link_holds_the_view(opened):
    view = opened().open(f"{ROUTE}&planners=shortest-path&walker=wheelchair&tab=reach")
    view.page.click("#zoom-in")
    view.until(lambda: not view.get("() => sidestep.map.isMoving()"))
    camera = view.get(CAMERA)
    view.until(lambda: f"map={camera[2]:.2f}/{camera[1]:.5f}/{camera[0]:.5f}" in view.page.url)
    link = view.page.url
    assert all(
        part in link
        for part in (
            f"from={FROM}",
            f"to={TO}",
            "at=Sat-17:30",
            "planners=shortest-path",
            "walker=wheelchair",
            "tab=reach",
        )
    )
    other = opened().open(link.partition("/#")[2].join(["#", ""]))
    expect(other.page.locator("#time-shown")).to_have_text("Saturday 17:30")
    expect(other.page.locator("#tab-reach")).to_have_attribute("aria-selected", "true")
    expect(other.page.locator("#walker")).to_have_value("wheelchair")
    assert other.get(CAMERA) == pytest.approx(camera, abs=0.01)
    assert other.get("() => sidestep.state.planners") == ["shortest-path"]


def test_links_that_make_no_sense_show_the_town_and_say_what_is_left_out(opened):
    view = opened().open(
        "#from=1e99,x&to=&at=Someday&by=25:00&planners=%3Cb%3E,shortest-path&tab=none&map=14/500/24.9&walker=ghost&avoid=1,2,3;street:&goal=5"
    )
    names = ["from", "to", "at", "by", "avoid", "planners", "walker", "tab"]
    assert view.get("(names) => names.map((name) => sidestep.state[name])", names) == [
        None, None, None, "", [], ["shortest-path"], "", "routes",
    ]  # fmt: skip
    said = view.page.locator("#alert-says")
    for part in (
        "from=1e99,x",
        "at=Someday",
        "by=25:00",
        "planners=<b>",
        "tab=none",
        "map=14/500/24.9",
        "walker=ghost",
    ):
        expect(said).to_contain_text(part)
    for part in ("avoid=1,2,3", "avoid=street:", "goal=5"):
        expect(said).to_contain_text(part)
    expect(said).not_to_contain_text(re.compile("shortest-path|to="))
    view.get("(link) => { location.hash = link; }", f"#from={FROM}&to={TO}")
    expect(view.page.locator("#alert")).to_be_hidden()


def test_refusals_are_one_sentence(opened):
    view = opened(allowed=("status of 4",)).open("#from=25.5,60.9&to=24.948,60.1655&at=Sat-17:30")
    expect(view.page.locator("#alert")).to_be_visible()
    expect(view.page.locator("#alert-says")).to_contain_text(re.compile("street|town|250 m"))
    view.page.click("#alert-close")
    expect(view.page.locator("#alert")).to_be_hidden()


def test_a_message_that_is_closed_stays_closed_until_something_else_is_asked(opened):
    view = opened(allowed=("status of 4",))
    held = []
    view.page.route("**/route/v1/foot/**", lambda route: held.append(route))  # noqa: PLW0108 # Playwright takes no builtin
    view.open(ROUTE)
    view.until(lambda: len(held) == 2)
    alert, refused = view.page.locator("#alert"), view.page.locator("#routes-body").get_by_text("no answer")
    for turn, route in enumerate(held, 1):
        route.fulfill(status=400, json={"code": "InvalidValue", "message": "no such walk"})
        expect(refused).to_have_count(turn)
        if turn == 1:
            expect(alert).to_be_visible()
            view.page.click("#alert-close")
        expect(alert).to_be_hidden()
    view.page.unroute("**/route/v1/foot/**")
    view.page.route(
        "**/route/v1/foot/**",
        lambda route: route.fulfill(status=400, json={"code": "InvalidValue", "message": "no such walk"}),
    )
    view.page.locator("#slider").fill("240")
    expect(alert).to_be_visible()


def test_without_webgl_the_tables_work(opened):
    init = "HTMLCanvasElement.prototype.getContext = () => null;"
    view = opened(init=init, allowed=("WebGL", "webgl")).open(ROUTE, drawn=False)
    expect(view.page.locator("#no-map")).to_contain_text("WebGL is off")
    expect(first_row(view)).to_contain_text(re.compile(r"expected.*\d"))
    view.page.click("#tab-crowds")
    expect(view.page.locator("#densest-body tr")).to_have_count(10)


@BOTH
def test_accessibility(opened, axe, size):
    view = opened(size, color_scheme="light", reduced_motion="reduce").open(ROUTE)
    view.get(axe)
    for tab in TABS:
        view.page.click(f"#tab-{tab}")
        if tab == "leave":
            expect(view.page.locator(".curve")).to_be_visible(timeout=60000)
        if tab == "routes":
            expect(view.page.locator("#routes-body").get_by_text("Another way").first).to_be_visible(timeout=60000)
            assert view.get(SMALL) == []
        if tab == "reach":
            expect(view.page.locator("#reach-found tbody tr")).to_have_count(3, timeout=60000)
        assert view.get(VIOLATIONS, {}) == [], tab
        view.page.emulate_media(color_scheme="dark")
        assert view.get(VIOLATIONS, COLOURS) == [], tab
        view.page.emulate_media(color_scheme="light")
    assert view.get("() => document.documentElement.scrollWidth <= innerWidth")
    town = view.server.ask("/town")
    expect(view.page.locator("#synthetic")).to_contain_text(town["synthetic"])
    expect(view.page.locator("#attribution")).to_contain_text("OpenStreetMap")


def test_another_town_at_the_same_address_is_shown(opened, serve, small, tmp_path):
    one, other = small("one", 2), small("other", 3)
    names = "() => sidestep.map.getSource('names').serialize().data.features.map(({ properties }) => properties.name)"
    with serve(one, tmp_path) as running:
        view = opened(server=running, allowed=("ERR_", "503")).open(
            "#from=0.0002,0&to=0.0016,0&at=Sat-17:30&by=18:30&planners=expected"
        )
        view.until(lambda: set(view.get(names)) == {"one 0", "one 1"})
        # Its crowds know no times, so there are none to choose.
        expect(view.page.locator("#time-shown")).to_have_text("From the start")
        expect(first_row(view)).to_contain_text(re.compile(r"expected.*\d", re.DOTALL))
        for name in ("#slider", "#day", "#now", "#play", "#arrive-by"):
            expect(view.page.locator(name)).to_be_hidden()
        port = int(running.address.rpartition(":")[2])
    with serve(other, tmp_path, port):
        # The page that is open notices, and what the browser keeps of the streets is asked for anew.
        expect(view.page.locator("#town")).to_have_text("Other", timeout=30000)
        view.page.wait_for_selector("html[data-map=drawn]")
        view.until(lambda: set(view.get(names)) == {"other 0", "other 1", "other 2"})


def test_dark_is_chosen_and_remembered(opened):
    view = opened(color_scheme="light").open()
    view.page.click("#theme")
    assert view.get("() => sidestep.map.getPaintProperty('paper', 'background-color')") == "rgb(20, 24, 31)"
    view.page.reload()
    expect(view.page.locator("html")).to_have_attribute("data-theme", "dark")
