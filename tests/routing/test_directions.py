"""Bearings, turn words, crowding words, and streets joined to steps."""

from dataclasses import replace

import numpy as np
import pytest

from sidestep.routing.directions import Leg, bearings, compass_word, crowding_word, directions, mean_density, turn_word

DEGREE = 111_195.08  # m, on the equator


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [
        (0, 0, "straight on"),
        (350, 10, "straight on"),
        (0, 20, "straight on"),
        (0, 21, "bear right"),
        (10, 330, "bear left"),
        (0, 90, "turn right"),
        (0, 270, "turn left"),
        (90, 0, "turn left"),
        (0, 130, "sharp right"),
        (0, 230, "sharp left"),
        (0, 180, "turn round"),
        (270, 92, "turn round"),
    ],
)
def test_turn_words(before: float, after: float, word: str) -> None:
    assert turn_word(before, after) == word


@pytest.mark.parametrize(
    ("bearing", "word"),
    [(0, "north"), (22, "north"), (23, "north-east"), (90, "east"), (225, "south-west"), (359, "north")],
)
def test_compass_words(bearing: float, word: str) -> None:
    assert compass_word(bearing) == word


@pytest.mark.parametrize(
    ("density", "word"),
    [(0, "free"), (0.3, "free"), (0.31, "busy"), (0.72, "dense"), (2.16, "dense"), (2.17, "jammed"), (9, "jammed")],
)
def test_crowding_words(density: float, word: str) -> None:
    assert crowding_word(density) == word


def test_bearings_look_some_way_along_the_street() -> None:
    # The last metre onto the crossing leads north, the street itself east.
    course = np.array([[0, 0], [0, 1], [100, 1], [100, 2]]) / DEGREE
    begins, ends = bearings(course)
    assert begins == pytest.approx(86, abs=1)
    assert ends == pytest.approx(86, abs=1)
    assert bearings(np.array([[0, 0], [0, -3]]) / DEGREE) == pytest.approx((180, 180))


def leg(*points, name="", kind="footway", minutes=1.0, density=0.1) -> Leg:
    course = np.array(points, float)
    return Leg(
        segment=0,
        metres=float(np.linalg.norm(np.diff(course, axis=0), axis=1).sum()),
        minutes=minutes,
        density=density,
        exposure=0.0,
        too_dense=False,
        street=0,
        name=name,
        kind=kind,
        coordinates=(course / DEGREE).tolist(),
    )


def test_streets_of_one_name_are_joined() -> None:
    steps = directions(
        [
            leg((0, 0), (100, 0), name="Long Street"),
            leg((100, 0), (100, 50), name="Long Street", minutes=3.0, density=0.5),
            leg((100, 50), (200, 50), name="Quay"),
        ]
    )
    assert [(step.turn, step.street, step.metres, step.minutes) for step in steps] == [
        ("head east", "Long Street", 150, 4),
        ("turn right", "Quay", 100, 1),
    ]
    assert [step.first_leg for step in steps] == [0, 2]
    # over the time on the way
    assert steps[0].density == pytest.approx(0.4)


def test_unnamed_streets_are_joined_straight_on_only() -> None:
    steps = directions(
        [
            leg((0, 0), (0, 50)),
            leg((0, 50), (0, 100)),
            leg((0, 100), (50, 100)),
            leg((50, 100), (80, 100), kind="living_street"),
            leg((80, 100), (90, 100), name="footway"),  # somebody called it so
        ]
    )
    assert [(step.turn, step.street) for step in steps] == [
        ("head north", "footway"),
        ("turn right", "footway"),
        ("straight on", "living street"),
        ("straight on", "footway"),
    ]


@pytest.mark.parametrize(
    ("kind", "name", "street"), [("area", "", "square"), ("area", "Market", "Market"), ("platform", "", "platform")]
)
def test_a_square_is_crossed_in_one_step_however_the_way_bends(kind: str, name: str, street: str) -> None:
    square = [((0, 50), (30, 60)), ((30, 60), (40, 90)), ((40, 90), (90, 90))]
    across = [leg(*ends, kind=kind, name=name) for ends in square]
    steps = directions([leg((0, 0), (0, 50)), *across, leg((90, 90), (90, 200))])
    assert [(step.turn, step.street, step.first_leg) for step in steps] == [
        ("head north", "footway", 0),
        ("turn right", street, 1),
        ("turn left", "footway", 4),
    ]


def test_a_bend_within_a_few_metres_is_no_turn() -> None:
    bends = [leg((0, 0), (0, 50)), leg((0, 50), (6, 58)), leg((6, 58), (6, 100)), leg((6, 100), (50, 144))]
    assert [(step.turn, step.first_leg) for step in directions(bends)] == [("head north", 0), ("bear right", 3)]
    corner = [leg((0, 0), (0, 50)), leg((0, 50), (8, 50)), leg((8, 50), (8, 100))]
    assert [step.turn for step in directions(corner)] == ["head north", "turn right", "turn left"]


@pytest.mark.parametrize(
    ("between", "steps"),
    [
        ([((100, 0), (112, 0))], 1),
        ([((100, 0), (108, 6))], 1),  # askew
        ([((100, 0), (106, 0)), ((106, 0), (112, 0))], 1),
        ([((100, 0), (125, 0))], 3),  # long enough to be told
        ([((100, 0), (100, 12))], 3),  # round two corners
    ],
)
def test_a_street_goes_on_behind_a_few_metres_of_another(between: list, steps: int) -> None:
    end = between[-1][1]
    after = leg(end, (end[0] + 200, end[1]), name="Long Street")
    crossed = [leg(*ends, name="Quay") for ends in between]
    found = directions([leg((0, 0), (100, 0), name="Long Street"), *crossed, after])
    assert [step.street for step in found] == ["Long Street", "Quay", "Long Street"][:steps]
    assert sum(step.metres for step in found) == pytest.approx(sum(each.metres for each in (*crossed, after)) + 100)
    # Another street behind it is another step, and so is one before which people wait.
    for other in (replace(after, name="Low Street"), replace(after, opens="06:00"), replace(after, name="")):
        assert len(directions([leg((0, 0), (100, 0), name="Long Street"), *crossed, other])) == 3


def test_who_turns_round_is_told_so() -> None:
    steps = directions([leg((0, 0), (50, 0), name="Quay"), leg((50, 0), (0, 0), name="Quay")])
    assert [step.turn for step in steps] == ["head east", "turn round"]


def test_no_time_no_crowds() -> None:
    assert mean_density([]) == 0


def test_bearings_across_the_antimeridian() -> None:
    assert bearings(np.array([[179.9999, 0.0], [-179.9999, 0.0]])) == pytest.approx((90, 90))
