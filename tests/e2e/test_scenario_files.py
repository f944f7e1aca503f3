"""Scenario files as people use them: made, walked, and refused."""

import json


def one_sentence(done) -> str:
    assert done.returncode == 2, (done.returncode, done.stdout, done.stderr)
    assert done.stderr.startswith("sidestep: ")
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


def test_a_new_scenario_runs_as_it_is_and_bad_ones_are_refused(sidestep, tmp_path) -> None:
    made = sidestep("new", "my-town", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "my-town/scenario.toml" in made.stdout
    file = tmp_path / "my-town" / "scenario.toml"
    walks = ("--walks", 4, "--planners", "shortest-path")
    done = sidestep("compare", "my-town/scenario.toml", *walks, "--crowding", 2, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["scenario"], found["walks"]) == ("my-town", 4)
    assert found["planners"]["shortest-path"]["arrival_rate"] == 1

    before = file.read_text()
    assert "my-town exists already" in one_sentence(sidestep("new", "my-town", cwd=tmp_path))
    assert file.read_text() == before

    file.write_text(before.replace("\nreach = 150", "\nreach = 'far'"))
    line = 2 + before[: before.index("\nreach = 150")].count("\n")
    sentence = one_sentence(sidestep("compare", "my-town/scenario.toml", *walks, cwd=tmp_path))
    assert f"my-town/scenario.toml: line {line}: place.crowd_source.reach " in sentence
