"""Studies: every mistake has its field and line; every job a name of its own."""

import re
from pathlib import Path

import pytest

from sidestep.cli import app as cli
from sidestep.experiments.study import Study, StudyError, StudyFile, labels, read_study

ROOT = Path(__file__).parents[2]
SMALL = "scenarios = 'paper-congested'\nchanges = { side = 3, crowded_nodes = 1 }\nwalks = 5\n"


@pytest.fixture
def study(tmp_path):
    def read(text: str) -> Study:
        file = tmp_path / "some.toml"
        file.write_text(text)
        return read_study(file)

    return read


def names(found: Study) -> list[str]:
    return [job.name for job in found.jobs]


def test_the_least_study(study) -> None:
    found = study("scenarios = 'rush-16'\n")
    assert found.name == "some"
    assert names(found) == ["rush-16_map-0_seed-0_planners", "rush-16_map-0_seed-0_local_default"]
    walked, trained = found.jobs
    assert walked.planners == ("shortest-path", "expected", "clairvoyant")
    assert (walked.agent, walked.walks, trained.planners) == (None, 500, ())


def test_every_combination_is_a_job_with_a_name_of_its_own(study) -> None:
    found = study(
        "scenarios = ['rush-16', 'shifting-crowds']\nmaps = '2-3'\nseeds = [0, 5]\nlevels = ['local', 'map']\n"
        "presets = ['default', 'dqn']\n[changes]\nside = [4, 5]\ncrowded_nodes = 1\n"
        "[settings]\ngamma = [1.0, 0.9]\nhidden = [[8, 8], [16]]\nrounds = 2\n"
        "[variants.no-potential]\npotential = false\n"
    )
    problems, places, agents = 2 * 2, 2 * 2, 2 * 2 * 4 * 2
    assert len(found.jobs) == len(set(names(found))) == problems * places * (agents + 1)
    assert "rush-16_side=4_map-2_seed-5_map_dqn_no-potential_gamma=0.9_hidden=8x8" in names(found)
    assert {job.agent.config.rounds for job in found.jobs if job.agent} == {2}
    assert {job.agent.config.hidden for job in found.jobs if job.agent} == {(8, 8), (16,)}
    assert {job.scenario.place.side for job in found.jobs} == {4, 5}
    said = labels(found.jobs)
    assert said["rush-16_side=4_map-2_seed-5_map_dqn_gamma=0.9_hidden=16"] == "darp-map-dqn-gamma=0.9-hidden=16"


def test_jobs_have_the_same_names_in_larger_studies(study) -> None:
    less = study(SMALL)
    more = study(SMALL + "seeds = '0-3'\npresets = ['default', 'paper']\nplanners = 'snapshot'\n")
    assert set(names(less)) < set(names(more))
    assert set(labels(less.jobs).values()) == {"darp"}  # what all agents have in common is not said


def test_grids_have_what_stands_above_them_and_share_planners(study) -> None:
    found = study(
        "seeds = [1, 2]\nwalks = 7\nplanners = 'snapshot'\n"
        "[grids.a]\nscenarios = 'rush-16'\nlevels = 'local'\n[grids.a.variants.x]\ngamma = 0.5\n"
        "[grids.b]\nscenarios = 'rush-16'\nlevels = 'map'\nplanners = 'forecast'\n"
    )
    agents = [job.agent.name for job in found.jobs if job.agent and job.seed == 1]
    assert agents == ["local_default", "local_default_x", "map_default"]
    walked = [job for job in found.jobs if job.agent is None]
    assert [set(job.planners[3:]) for job in walked] == [{"snapshot", "forecast"}] * 2
    assert {job.walks for job in found.jobs} == {7}


def test_a_variant_that_changes_nothing_at_a_level_is_not_trained_there(study) -> None:
    found = study("scenarios = 'rush-16'\nlevels = ['local', 'map']\n[variants.six]\nn_step = 6\n")
    assert [job.agent.name for job in found.jobs if job.agent] == ["local_default", "local_default_six", "map_default"]


def test_held_out_maps_are_walked_where_there_are_training_maps(study) -> None:
    assert {job.walked for job in study("scenarios = 'unseen-maps'\n").jobs} == {tuple(range(12))}
    assert {job.walked for job in study("scenarios = 'rush-16'\nmaps = 3\n").jobs} == {(3,)}


def test_scenario_files_are_looked_for_from_the_study(study, tmp_path) -> None:
    (tmp_path / "town.toml").write_text('[place]\nstreets = "helsinki"\n')
    assert study("scenarios = 'town.toml'\nlevels = 'map'\n").jobs[0].scenario.name == "town"


@pytest.mark.parametrize(
    ("text", "field", "line"),
    [
        ("", None, None),
        ("walks = 5\nwalks = 6\n", None, 2),
        ("walks = 5\n", "scenarios", 1),
        ("walks = 5\nscenarios = 'rush-61'\n", "scenarios", 2),
        ("walks = 5\nscenarios = 'nowhere.toml'\n", "scenarios", 2),
        ("scenarios = []\n", "scenarios", 1),
        (SMALL + "scenari = 3\n", "scenari", 4),
        (SMALL + "seeds = []\n", "seeds", 4),
        (SMALL + "seeds = [1, 1]\n", "seeds", 4),
        (SMALL + "seeds = [1, -1]\n", "seeds", 4),
        (SMALL + "seeds = 'all'\n", "seeds", 4),
        (SMALL + "seeds = '3-1'\n", "seeds", 4),
        (SMALL + "seeds = '0-99999'\nmaps = [0, 1]\n", "seeds", 4),  # too many jobs
        (SMALL + "maps = 0.5\n", "maps", 4),
        (SMALL + "levels = 'lokal'\n", "levels", 4),
        (SMALL + "presets = 'defualt'\n", "presets", 4),
        (SMALL + "\nlevels = 'map'\npresets = 'paper'\n", "presets", 6),
        ("scenarios = 'helsinki'\nlevels = ['map', 'position']\n", "levels", 2),
        ("scenarios = 'unseen-maps'\nmaps = [0, 1]\n", "maps", 2),
        ("scenarios = 'unseen-maps'\n[settings]\nplaces = 4\n", "settings.places", 3),
        (SMALL + "planners = ['snapshto']\n", "planners", 4),
        (SMALL + f"[variants.{'x' * 250}]\ngamma = 0.5\n", "scenarios", 1),
        (SMALL + "planners = 'darp'\n", "planners", 4),
        (SMALL.replace("walks = 5", "walks = 0"), "walks", 3),
        (SMALL + "[settings]\n\nrouns = 3\n", "settings.rouns", 6),
        (SMALL + "[settings]\ngamma = [1.0, 1.5]\n", "settings.gamma", 5),
        (SMALL + "[settings]\ngamma = []\n", "settings.gamma", 5),
        (SMALL + "[settings]\ngamma = [1, 0.5, 1.0]\n", "settings.gamma", 5),
        (SMALL + "[settings]\ndouble = [true, true]\n", "settings.double", 5),
        (SMALL + "[settings]\nhidden = [[8, 8], [8], [8, 8]]\n", "settings.hidden", 5),
        ("scenarios = 'rush-16'\n[changes]\nside = [3, 4, 3]\n", "changes.side", 3),
        (SMALL + "[variants.'']\ngamma = 0.5\n", "variants", 4),
        (SMALL + "[settings]\nself = 3\n", "settings.self", 5),
        (SMALL + "[settings]\nlevel = 'map'\n", "settings.level", 5),
        (SMALL + "[variants.a]\ngama = 1.0\n", "variants.a.gama", 5),
        (SMALL + "[variants.a]\ngamma = 1.0\n", "variants.a", 4),
        ("scenarios = 'rush-16'\n[changes]\nsyde = 3\n", "changes.syde", 3),
        ("scenarios = 'rush-16'\n[changes]\nside = 'x'\n", "changes.side", 3),
        ("scenarios = 'rush-16'\n[grids.a]\nwalks = 2\n[grids.b]\nwalks = 'x'\n", "grids.b.walks", 5),
        ("[grids.a]\nscenarios = 'rush-16'\n[grids.b]\nwalks = 3\n", "grids.b.scenarios", 3),
        ("walks = 5\n[grids.a]\nscenarios = 'rush-16'\n[grids.b]\nscenarios = 'rush-61'\n", "grids.b.scenarios", 5),
        ("levels = 'live'\n[grids.a]\nscenarios = 'rush-16'\npresets = 'paper'\n", "grids.a.presets", 4),
        ("scenarios = 'rush-16'\n[grids.a]\nwalks = 2\n[grids.b]\nwalks = 3\n", "grids", 2),
    ],
)
def test_mistakes_have_their_field_and_line(study, text: str, field: str | None, line: int | None) -> None:
    with pytest.raises(StudyError) as error:
        study(text)
    assert (error.value.field, error.value.line) == (field, line)


def test_what_to_do_about_a_job_that_is_asked_for_twice(study) -> None:
    for key, remedy in (("walks", "ask for the same in all grids"), ("settings.rounds", "make rounds a list")):
        with pytest.raises(StudyError) as error:
            study(f"scenarios = 'rush-16'\n[grids.a]\n{key} = 2\n[grids.b]\n{key} = 3\n")
        assert str(error.value).endswith(remedy)


@pytest.mark.parametrize("gamma", ["0.5", "0.4"])
def test_variants_that_would_share_a_folder_are_both_named(study, gamma: str) -> None:
    with pytest.raises(StudyError) as error:
        study(SMALL + f"[variants.'a b']\ngamma = 0.5\n[variants.a-b]\ngamma = {gamma}\n")
    assert "default_a b and " in str(error.value)
    assert "default_a-b would" in str(error.value)
    assert (error.value.field, error.value.line) == ("variants", 4)


def test_all_mistakes_in_values_are_told_at_once(study) -> None:
    with pytest.raises(StudyError) as error:
        study("scenarios = 3\nwalks = 0\nunknown = 1\n")
    assert [each.field for each in (error.value, *error.value.others)] == ["scenarios", "walks", "unknown"]


def test_reproduce_in_small_has_as_many_maps_as_asked(tmp_path, capsys) -> None:
    command = ["reproduce", "--quick", "--maps", "200000", "--scheduler", "nowhere", "--out", str(tmp_path / "out")]
    assert cli.run(command) == cli.BAD_INPUT
    assert "jobs" in capsys.readouterr().err  # too many


def test_no_file(tmp_path) -> None:
    with pytest.raises(StudyError):
        read_study(Path(tmp_path / "none.toml"))


@pytest.mark.parametrize(
    ("name", "agents"), [("small", 8), ("levels", 3 * 10), ("ablations", 3 * 12), ("towns", 3 * 3)]
)
def test_the_examples(name: str, agents: int) -> None:
    found = read_study(ROOT / "examples" / "studies" / f"{name}.toml")
    assert sum(job.agent is not None for job in found.jobs) == agents


def test_the_study_of_the_page_is_the_small_one(study) -> None:
    page = (ROOT / "docs" / "sweeps.md").read_text()
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert study(text).jobs == read_study(ROOT / "examples" / "studies" / "small.toml").jobs
    for key in StudyFile.model_fields:
        assert f"| `{key}` |" in page
