"""`sidestep route` past a gate that is shut at night, and into streets for those only who have an end there."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest

from sidestep.agent.presets import preset
from sidestep.agent.runs import train
from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.errors import SidestepError
from sidestep.network.formats import load_town, save_town
from sidestep.network.town import Town
from sidestep.planners.base import Planner, routes
from sidestep.planners.learned import trained_darp
from sidestep.planners.time_dependent import Clairvoyant
from sidestep.routing.router import Router
from sidestep.scenarios.episodes import check_paths, instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import WORDS
from sidestep.scenarios.reader import load_scenario

OPEN = "06:00-22:00"
NIGHT, NOON, DAWN = "2025-05-24T23:30", "2025-05-24T12:00", "2025-05-26T05:50"


@pytest.fixture(scope="module")
def venue(tmp_path_factory):
    """A scenario on the block of footways, without a crowd."""
    folder = tmp_path_factory.mktemp("block")

    def make(name: str, town: Town, traffic: str = "") -> Path:
        save_town(town, folder / f"{name}.npz")
        again = load_town(folder / f"{name}.npz")
        assert again.opening == town.opening
        rows = [f"0,,2025-05-{day}T{hour:02}:00,0" for day in range(19, 26) for hour in range(24)]
        (folder / "crowd.csv").write_text("\n".join(["street,direction,time,density", *rows]))
        save_crowd_table(read_table(folder / "crowd.csv", town), folder / f"{name}-crowd.npz")
        file = folder / f"{name}.toml"
        file.write_text(
            'law = "weidmann"\nhorizon_minutes = 60\ndepartures_minutes = [0, 0]\n'
            f'[place]\nstreets = "{name}.npz"\nhours = [0, 24]\n'
            f'[place.crowd_source]\nkind = "crowd_table"\nfile = "{name}-crowd.npz"\n{traffic}'
        )
        return file

    return make


def metres(router: Router, depart: str, planner: str | Planner = "expected", ends=(5, 10)) -> float:
    found = router.plan(*ends, depart=depart, planner=planner)
    assert found.arrives
    return found.metres


def test_the_gate_by_the_clock(venue, block) -> None:
    router = Router(load_scenario(venue("gate", block(OPEN))))
    assert [metres(router, depart) for depart in (NIGHT, NOON)] == pytest.approx([240, 169.7], abs=0.1)


def test_a_wait_is_told(venue, make_town, sidestep) -> None:
    # 0 and 1 are joined by a gate alone.
    town = make_town([(0, 0), (100, 0), (200, 0)], [(0, 1), (1, 2)], opening=("", OPEN), name=("High Street", "Park"))
    file = venue("park", town)
    ends = ("--from", "0", "--to", "2", "--depart", DAWN)
    said = sidestep("route", file, *ends)
    assert said.returncode == 0, said.stderr
    assert "wait until 06:00, then straight on" in said.stdout
    found = json.loads(sidestep("route", file, *ends, "--json").stdout)
    assert [leg["opens"] for leg in found["legs"]] == [None, "06:00"]
    waited = 10 - 100 / 1.34 / 60
    assert found["legs"][1]["minutes_until_open"] == pytest.approx(waited, abs=0.01)
    assert found["legs"][1]["minutes"] == pytest.approx(waited + 100 / 1.34 / 60, abs=0.01)
    assert found["expected_minutes"] == pytest.approx(10 + 100 / 1.34 / 60, abs=0.01)
    assert found["steps"][1]["turn"] == "wait until 06:00, then straight on"
    # From the middle of the park one waits as well: the gate may be at either end.
    inside = json.loads(sidestep("route", file, "--from", "0,0.00135", "--to", "2", "--depart", DAWN, "--json").stdout)
    assert inside["legs"][0]["opens"] == "06:00"
    late = json.loads(sidestep("route", file, *ends[:-1], "2025-05-26T01:00", "--json").stdout)
    assert (late["arrives"], late["arrival_rate"], late["expected_minutes"]) == (False, 0, 60)


def test_streets_for_those_who_have_an_end_there(venue, block) -> None:
    town = block(restricted=True)
    router = Router(load_scenario(venue("residents", town)))
    assert metres(router, NOON) == pytest.approx(240, abs=0.1)
    longitude, latitude = town.course(24).mean(axis=0).tolist()
    middle = (latitude, longitude)
    for ends in ((5, middle), (middle, 10)):
        assert metres(router, NOON, ends=ends) == pytest.approx(84.9, abs=0.1)
        assert metres(router, NOON, "shortest-path", ends) == pytest.approx(84.9, abs=0.1)


def test_a_street_that_is_never_open_is_no_way(venue, make_town) -> None:
    town = make_town([(0, 0), (100, 0), (200, 0)], [(0, 1), (1, 2)], opening=("", "off"))
    scenario = load_scenario(venue("off", town))
    for refused, field in (
        (lambda: Router(scenario).plan(0, 2), "destination"),
        (lambda: check_paths(draw_map(scenario, 0)), None),
    ):
        with pytest.raises(SidestepError) as caught:
            refused()
        assert caught.value.field == field


def test_times_to_many_places_just_before_a_gate_shuts(venue, make_town) -> None:
    # 200 m past a gate, or 256 m round it; whoever sets out at 21:57 comes to the gate at 21:58:15.
    corners = [(0, 0), (100, 0), (200, 0), (150, 60)]
    town = make_town(corners, [(0, 1), (1, 2), (1, 3), (3, 2)], opening=("", OPEN, "", ""))
    scenario = load_scenario(venue("shutting", town))
    for objective in ("time", "distance"):
        router = Router(scenario.changed(objective=WORDS[objective]))
        for depart, far in (("Sat 21:57", 200), ("Sat 23:30", 256.2)):
            minutes = pytest.approx(far / 1.34 / 60, abs=0.01)
            assert router.plan(0, 2, depart=depart).expected_minutes == minutes
            assert router.matrix([0], [2], depart=depart).minutes == [[minutes]]


@pytest.mark.parametrize("planner", ["greedy-map", "forecast"])
@pytest.mark.parametrize(("north", "depart", "far"), [(67, "Sat 21:57", 268), (150, "Sat 21:58:25", 402.3)])
def test_gates_that_shut_within_a_slot(venue, make_town, planner: str, north: int, depart: str, far: float) -> None:
    # 100 s to a gate, and as long on; or round it. A slot begins at the departure.
    corners = [(0, 0), (134, 0), (268, 0), (134, north)]
    town = make_town(corners, [(0, 1), (1, 2), (0, 3), (3, 2)], opening=("", OPEN, "", ""))
    router = Router(load_scenario(venue(f"slot-{north}", town)))
    assert router.plan(0, 2, depart=depart, planner=planner).metres == pytest.approx(far, abs=0.1)


@pytest.mark.parametrize("planner", ["greedy-map", "forecast"])
@pytest.mark.parametrize(("depart", "far"), [("Sat 21:58:05", 268), ("Sat 21:58:25", 314)])
def test_gates_at_ones_own_crossing_are_seen_to_the_second(venue, make_town, planner: str, depart: str, far: float):
    # One comes to the gate 15 s before it shuts, or 5 s after, between two steps of the costs to go.
    corners = [(0, 0), (134, 0), (268, 0), (201, 60)]
    town = make_town(corners, [(0, 1), (1, 2), (1, 3), (3, 2)], opening=("", OPEN, "", ""))
    router = Router(load_scenario(venue("seconds", town)))
    assert router.plan(0, 2, depart=depart, planner=planner).metres == pytest.approx(far, abs=0.5)


def test_by_length_a_gate_that_is_shut_is_no_short_cut(venue, make_town) -> None:
    # 200 m past a gate, 256 m round it, or 283 m.
    corners = [(0, 0), (100, 0), (200, 0), (100, 80), (100, -100)]
    ends = [(0, 1), (1, 2), (0, 3), (3, 2), (0, 4), (4, 2)]
    router = Router(load_scenario(venue("round", make_town(corners, ends, opening=("", OPEN, "", "", "", "")))))
    for depart, first, other in ((NOON, 200, 256.1), ("Sat 05:40", 256.1, 282.8)):
        asked = {"depart": depart, "planner": "shortest-path"}
        plan = router.plan(0, 2, alternatives=1, **asked)
        assert [each.metres for each in (plan, *plan.alternatives)] == pytest.approx([first, other], abs=0.1)
        assert router.matrix([0], [2], **asked).minutes == [[pytest.approx(plan.expected_minutes, abs=0.01)]]


def test_one_waits_once_for_each_street(venue, make_town) -> None:
    # 500 m behind one gate; whoever comes in time walks on past places in the middle after it has shut.
    town = make_town([(0, 0), (100, 0), (600, 0), (700, 0)], [(0, 1), (1, 2), (2, 3)], opening=("", OPEN, ""))
    scenario = load_scenario(venue("long", town))
    first, second = ((0, x / 111_195.08) for x in (200, 500))
    far = [700 / 1.34 / 60, 500 / 1.34 / 60, 200 / 1.34 / 60]
    for objective in ("time", "distance"):
        router = Router(scenario.changed(objective=WORDS[objective]))
        found = router.matrix([0, first, second], [3], depart="Sat 21:58")
        assert [row[0] for row in found.minutes] == pytest.approx(far, abs=0.01)
        found = router.matrix([first], [second, 3], depart="Sat 22:00")  # shut where they begin, until the horizon
        assert found.minutes == [[None, None]]
        plan = router.plan(first, 3, depart="Sat 21:58", futures=2)
        assert (plan.expected_minutes, plan.arrival_rate) == (pytest.approx(far[1], abs=0.01), 1)
        minutes = router.plan(first, 3, depart="Sun 05:50").expected_minutes
        assert minutes == pytest.approx(10 + far[1], abs=0.01)
    found = router.matrix([first], [3], depart="Sun 05:50", futures=2)
    assert found.minutes == found.p50 == found.p90 == [[pytest.approx(10 + far[1], abs=0.01)]]
    # Reach is measured on both pieces of the street.
    area, _ = router.isochrone(first, minutes=[5, 12.5], depart="Sun 05:50").areas
    assert area.kilometres == 0


def test_agents_learn_among_gates_and_streets_for_residents(venue, block) -> None:
    town = block(OPEN)
    restricted = np.arange(town.streets) == 0  # between 0 and 1
    file = venue("learned", replace(town, restricted=restricted))
    scenario = load_scenario(file).changed(level="live", destinations=(10,), hours=(20, 24), horizon=1800.0)
    config = preset("default", "live").changed(
        rounds=2, round_steps=64, walkers=16, batch=16, capacity=64, hidden=(8,), places=2, n_step=3, futures=4,
        fresh_futures=2, test_walks=2,
    )  # fmt: skip
    drawn = draw_map(scenario, 0)
    params = make_environment(scenario, drawn, "test", 4, level="live")
    todo = instances(scenario, drawn, params, 12)
    planners = (trained_darp(train(scenario, config).model), Clairvoyant())
    learned, bound = (routes(planner, params, todo, jax.random.key(0), 60) for planner in planners)
    taken = np.asarray(drawn.network.may_take(todo.destination[0]))
    for one, best in zip(learned, bound, strict=True):
        assert one.arrived
        assert taken[list(one.segments)].all()
        assert one.seconds >= best.seconds - 0.05


def test_a_deadline_just_after_a_gate_opens(venue, make_town) -> None:
    town = make_town([(0, 0), (100, 0), (200, 0)], [(0, 1), (1, 2)], opening=("", OPEN))
    router = Router(load_scenario(venue("deadline", town)))
    assert router.plan(0, 2, arrive_by="Sat 06:02").departs == "Saturday 05:59"
    with pytest.raises(SidestepError) as caught:  # who waits an hour is there at 06:01:15
        router.plan(0, 2, arrive_by="Sat 06:01")
    assert caught.value.field == "arrive_by"


def test_nobody_is_behind_a_gate_before_it_opens(venue, make_town) -> None:
    town = make_town([(0, 0), (100, 0), (500, 0)], [(0, 1), (1, 2)], opening=("", OPEN))
    router = Router(load_scenario(venue("early", town)))
    # At the gate by 05:51:15; at 06:02:30 they are 201 m behind it.
    shut, open_ = router.isochrone(0, minutes=[9, 12.5], depart="Sat 05:50").areas
    assert shut.kilometres == pytest.approx(0.1, abs=0.02)
    assert open_.kilometres == pytest.approx(0.301, abs=0.02)


def test_walks_through_the_area_that_they_end_in(venue, make_town) -> None:
    # Restricted from 0 to 3, with an open street at 2, to which everybody else walks round by 4 and 5.
    corners = [(0, 0), (100, 0), (200, 0), (300, 0), (0, -300), (200, -300)]
    ends = [(0, 1), (1, 2), (2, 3), (0, 4), (4, 5), (5, 2)]
    town = make_town(corners, ends, restricted=np.arange(6) < 3)
    scenario = load_scenario(venue("crossed", town))
    for objective in ("time", "distance"):
        router = Router(scenario.changed(objective=WORDS[objective]))
        minutes = [router.plan(0, end, depart=NOON).expected_minutes for end in (1, 2, 3, 5)]
        assert minutes == pytest.approx([metres / 1.34 / 60 for metres in (100, 800, 300, 500)], abs=0.01)
        assert router.matrix([0], [1, 2, 3, 5], depart=NOON).minutes == [pytest.approx(minutes, abs=0.01)]
        arrivals = router.isochrone(0, minutes=[4], depart=NOON)
        assert [arrivals.arrivals["expected"][end] for end in (1, 2, 3, 5)] == pytest.approx(minutes, abs=0.01)
        assert arrivals.areas[0].kilometres == pytest.approx(0.3 + 0.3216, abs=0.04)
