"""Walkers as people write them, in files, options and Python, and what is refused."""

import jax.numpy as jnp
import pytest

from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import find_scenario, load_scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.walkers import ADULT, WALKERS, Adult, Custom, Older, Robot, Wheelchair, read_walkers

HELSINKI = '[place]\nstreets = "helsinki"\n'


def test_everybody_walks_as_an_adult_unless_told_otherwise() -> None:
    problem = scenario("paper-congested")
    assert problem.walker == ADULT
    assert (ADULT.to_json(), ADULT.remark) == (None, "")
    assert problem.walker.speed_law("power") == problem.speed_law
    # Files from before there were walkers.
    before = problem.model_dump(mode="json", exclude={"walker"})
    assert "walker" not in before
    assert Scenario.model_validate_json(problem.model_dump_json(exclude={"walker"})) == problem
    whole = problem.changed(walker="robot")
    assert Scenario.model_validate_json(whole.model_dump_json()) == whole


def test_kinds_have_numbers_of_their_own() -> None:
    assert set(WALKERS) == {"adult", "older", "child", "wheelchair", "robot", "custom"}
    made = [kind() for name, kind in WALKERS.items() if name != "custom"]
    assert len({walker.free_speed for walker in made}) == 5
    for walker in made[1:]:
        assert scenario("rush-16", walker=walker.kind).walker == walker
        assert walker.kind in walker.remark
        assert f"{walker.free_speed:g} m/s" in walker.remark
        assert walker.to_json() == walker.model_dump()
    assert Adult(free_speed=1.5).to_json()["free_speed"] == 1.5


def test_the_robot_yields() -> None:
    # By 1 - exp(-1.913 (1/p - 1/5.4)) among .1, .5 and 1 persons/m², and among four times as many.
    adult, robot = (walker.speed_law("weidmann") for walker in (ADULT, Robot(free_speed=1.34)))
    density = jnp.array([0.1, 0.5, 1.0])
    assert (adult.speed(density) / 1.34).tolist() == pytest.approx([1.0, 0.968937, 0.789599], rel=1e-4)
    assert (robot.speed(density) / 1.34).tolist() == pytest.approx([0.988065, 0.452417, 0.116612], rel=1e-4)
    assert ADULT.speed_law("weidmann") != Adult(law="power-capped").speed_law("weidmann")
    assert Adult(law="power").speed_law("weidmann") == ADULT.speed_law("power")


def test_walkers_in_one_line() -> None:
    assert read_walkers("adult") == (ADULT,)
    assert read_walkers(" older , wheelchair") == (Older(), Wheelchair())
    two = read_walkers("older,free_speed=1.0,stairs=no,law=power-capped,custom,free_speed=0.5,lift_wait=90")
    assert two == (Older(free_speed=1.0, stairs=False, law="power-capped"), Custom(free_speed=0.5, lift_wait=90.0))
    # The kind of the scenario's walker means that walker.
    own = Custom(free_speed=0.9, lifts=False)
    assert read_walkers("custom,free_speed=1.0,adult", own) == (Custom(free_speed=1.0, lifts=False), ADULT)
    assert read_walkers("custom", own) == (own,)
    assert find_scenario("rush-16", walker="child").walker == WALKERS["child"]()


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "walker"),
        ("adults", "walker"),
        ("adult,", "walker"),
        ("Adult", "walker"),
        ("free_speed=1", "walker"),
        ("older,free_speed=", "walker"),
        ("older,free_speed=1,free_speed=2", "walker"),
        ("adult,adult", "walker"),
        ("custom", "free_speed"),
        ("older,speed=1", "speed"),
        ("older,kind=child", "kind"),
        ("older,free_speed=fast", "free_speed"),
        ("older,free_speed=0", "free_speed"),
        ("older,free_speed=-1", "free_speed"),
        ("older,free_speed=11", "free_speed"),
        ("older,free_speed=nan", "free_speed"),
        ("older,free_speed=inf", "free_speed"),
        ("older,free_speed=true", "free_speed"),
        ("older,stairs=1", "stairs"),
        ("older,stairs=maybe", "stairs"),
        ("older,stairs_up=0", "stairs_up"),
        ("older,law=linear", "law"),
        ("older,crowd_factor=0", "crowd_factor"),
        ("older,lift_wait=-1", "lift_wait"),
        ("older,lift_wait=1e9", "lift_wait"),
        ("older,least_width=-1", "least_width"),
        ("older,highest_kerb=-0.1", "highest_kerb"),
        ("older,steepest=0", "steepest"),
    ],
)
def test_walkers_that_cannot_be(text: str, field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        read_walkers(text)
    assert caught.value.field == field


def test_one_scenario_has_one_walker() -> None:
    with pytest.raises(ScenarioError) as caught:
        find_scenario("rush-16", walker="adult,older")
    assert caught.value.field == "walker"
    # On the empty streets of a venue the paper's law has no speed.
    assert scenario("paper-congested", walker=Adult(law="power")).walker.law == "power"
    with pytest.raises(ScenarioError) as caught:
        scenario("helsinki", walker=Adult(law="power"))
    assert caught.value.field == "walker"


def test_walkers_in_files(tmp_path) -> None:
    def load(text: str) -> Scenario:
        file = tmp_path / "scenario.toml"
        file.write_text(text)
        return load_scenario(file)

    assert load(HELSINKI).walker == ADULT
    assert load('walker = "older"\n' + HELSINKI).walker == Older()
    own = load(HELSINKI + '[walker]\nkind = "older"\nfree_speed = 1\nstairs_down = 0.5\n').walker
    assert own == Older(free_speed=1.0, stairs_down=0.5)
    for text, line, field in (
        ('walker = "dog"\n' + HELSINKI, 1, "walker.kind"),
        ("walker = 1\n" + HELSINKI, 1, "walker"),
        (HELSINKI + "[walker]\nfree_speed = 1.0\n", 3, "walker.kind"),
        (HELSINKI + '[walker]\nkind = "dog"\n', 4, "walker.kind"),
        (HELSINKI + '[walker]\nkind = "custom"\n', 3, "walker.free_speed"),
        (HELSINKI + '[walker]\nkind = "older"\nfree_speed = "1"\n', 5, "walker.free_speed"),
        (HELSINKI + '[walker]\nkind = "older"\nspeed = 1.0\n', 5, "walker.speed"),
        (HELSINKI + '[walker]\nkind = "older"\nlaw = "power"\n', 3, "walker"),
        # Nothing of Helsinki is left.
        (HELSINKI + '[walker]\nkind = "wheelchair"\nleast_width = 99.0\n', 3, "walker"),
    ):
        with pytest.raises(ScenarioError) as caught:
            load(text)
        assert (caught.value.line, caught.value.field) == (line, field), text
        assert "\n" not in str(caught.value)
