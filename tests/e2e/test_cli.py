"""The command line as people use it: real processes, real training, real files."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from cyclopts import CycloptsError

from sidestep.cli import app as cli
from sidestep.errors import SidestepError


@pytest.fixture(scope="session")
def environ(tmp_path_factory):
    # One compilation cache for all processes of a run, and none of the user's.
    return {**os.environ, "XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache")), "COLUMNS": "200"}


@pytest.fixture(scope="session")
def sidestep(environ):
    def run(*args, cwd=None):
        command = [sys.executable, "-m", "sidestep", *map(str, args)]
        return subprocess.run(command, env=environ, cwd=cwd, capture_output=True, text=True, timeout=300)

    return run


@pytest.fixture(scope="session")
def model(sidestep, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "m"
    done = sidestep("train", "paper-congested", "--side", 3, "--crowded-nodes", 1, "--rounds", 3, "--out", folder)
    assert done.returncode == 0, done.stderr
    assert "\nthe paper's 5 x 5 blocks, all segments at four nodes crowded by 5,000 people\n" in done.stdout
    return folder


@pytest.fixture(scope="session")
def local_model(sidestep, tmp_path_factory):
    """Of level local, on a map that `route` knows too; to nodes 35 and one other."""
    folder = tmp_path_factory.mktemp("models") / "local"
    args = ("train", "paper-congested", "--rounds", 1, "--level", "local", "--n-step", 2, "--destinations", 2)
    done = sidestep(*args, "--out", folder, "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def one_sentence(done, status=2):
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    assert done.stderr.startswith("sidestep: ")
    assert len(done.stderr.splitlines()) == 1
    assert "Traceback" not in done.stderr + done.stdout
    return done.stderr


def test_help_names_all_commands(sidestep):
    done = sidestep("--help")
    assert done.returncode == 0
    for command in ("demo", "reproduce", "train", "compare", "route", "trade-off", "counts"):
        assert re.search(rf"\b{command}\b", done.stdout)
        assert "--seed" in sidestep(command, "--help").stdout
        assert "--json" in sidestep(command, "--help").stdout


def test_help_loads_nothing_heavy():
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys, sidestep, sidestep.cli.app; print(*sys.modules)"],
        capture_output=True,
        text=True,
    ).stdout.split()
    assert not {"jax", "pandas", "matplotlib", "statsmodels", "equinox", "optax", "scipy"} & set(loaded)


def test_compare_prints_the_agreed_shape(sidestep, agreed_row):
    done = sidestep(
        "compare", "paper-congested", "--maps", 2, "--walks", 3, "--side", 3, "--crowded-nodes", 1, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # no bar where there is no terminal
    found = json.loads(done.stdout)
    assert (found["scenario"], found["maps"], found["walks"], found["seed"]) == ("paper-congested", 2, 3, 0)
    assert set(found["planners"]) == {
        "random-walk", "random-progress", "shortest-path", "expected", "clairvoyant",
        "greedy-local", "greedy-map", "snapshot", "forecast", "darp",
    }  # fmt: skip
    assert (found["baseline"], found["by_minutes"]) == ("expected", None)
    for row in found["planners"].values():
        assert set(row) >= agreed_row
        assert row["regret"] >= -1e-4
        assert row["ci95"][0] <= row["mean_minutes"] <= row["ci95"][1]
    assert found["planners"]["shortest-path"]["saving_vs_shortest_path"] == 0
    assert found["planners"]["clairvoyant"]["regret"] == 0


def test_the_same_seed_gives_the_same_numbers(sidestep):
    # As many walks on as small maps as above, so that what is compiled serves again.
    args = ("compare", "paper-congested", "--side", 3, "--crowded-nodes", 1, "--maps", 2, "--walks", 3, "--json")
    args = (*args, "--planners", "random-walk,expected")

    def minutes(*more):
        rows = json.loads(sidestep(*args, *more).stdout)["planners"]
        return {name: row["mean_minutes"] for name, row in rows.items()}

    assert minutes("--workers", 1) == minutes("--workers", 2)
    assert minutes() != minutes("--seed", 1)


def test_demo_writes_a_picture(sidestep, tmp_path):
    done = sidestep("demo", "--out", tmp_path / "d")
    assert done.returncode == 0, done.stderr
    assert "darp" in done.stdout
    assert (tmp_path / "d" / "map.png").read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in (tmp_path / "d").iterdir()] == ["map.png"]


def test_trade_off_draws_what_time_and_crowds_cost(sidestep, tmp_path):
    grid = ("paper-congested", "--side", 3, "--crowded-nodes", 1, "--seed", 2)
    picture = tmp_path / "new" / "t.png"
    args = ("--weights", "5,0", "--planners", "clairvoyant", "--walks", 3, "--out", picture, "--json")
    done = sidestep("trade-off", *grid, *args)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert found["picture"] == str(picture)
    ((name, points),) = found["curves"].items()
    assert (name, [point["weight"] for point in points]) == ("clairvoyant", [0, 5])
    # Less crowd for more time.
    fast, empty = points
    assert fast["minutes"] <= empty["minutes"]
    assert fast["exposure"] >= empty["exposure"]
    assert found["shortest_path"]["exposure"] >= empty["exposure"]
    assert (found["attribution"], empty["arrival_rate"]) == ("", 1)
    # The same walks with the same weight cost the same.
    done = sidestep(
        "compare", *grid, "--objective", "exposure=5", "--maps", 1, "--walks", 3, "--planners", "clairvoyant", "--json"
    )
    compared = json.loads(done.stdout)
    assert compared["objective"] == {"time": 1, "distance": 0, "exposure": 5, "max_density": None}
    row = compared["planners"]["clairvoyant"]
    assert (row["mean_minutes"], row["mean_exposure"]) == (empty["minutes"], empty["exposure"])
    assert row["mean_cost_minutes"] == pytest.approx(row["mean_minutes"] + 5 * row["mean_exposure"] / 60, rel=1e-4)


def test_train_resumes_where_it_was(sidestep, model):
    args = ("train", "paper-congested", "--side", 3, "--crowded-nodes", 1, "--json")
    straight = json.loads(sidestep(*args, "--rounds", 3).stdout)
    assert len(straight["curve_minutes"]) == 3
    assert one_sentence(sidestep(*args, "--rounds", 3, "--out", model, "--resume")).count("trained to the end") == 1
    assert "other" in one_sentence(sidestep(*args, "--rounds", 3, "--out", model, "--resume", "--seed", 5))
    assert "--out" in one_sentence(sidestep(*args, "--resume"))


def test_compare_takes_a_trained_model(sidestep, model):
    args = ("compare", "paper-congested", "--side", 3, "--crowded-nodes", 1, "--walks", 4, "--model", model)
    done = sidestep(*args, "--planners", "darp", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["maps"] == 1
    assert found["planners"]["darp"]["level"] == "position"
    assert found["planners"]["darp"]["arrival_rate"] >= 0
    assert list(found["planners"]) == ["shortest-path", "expected", "clairvoyant", "darp"]
    said = one_sentence(sidestep("compare", "paper-unblocked", "--model", model))
    assert f"the model in {model} remembers the 9 nodes of map 0 of paper-congested, seed 0; this map is" in said
    assert "one of 36 nodes" in said
    assert "this map is another of as many" in one_sentence(sidestep(*args, "--seed", 7))
    assert f"the model in {model} is of level position, not local" in one_sentence(sidestep(*args, "--level", "local"))


def test_a_level_is_trained_and_said(local_model):
    folder, summary = local_model
    assert (summary["level"], summary["config"]["level"], summary["map"]) == ("local", "local", 0)
    assert (summary["config"]["n_step"], summary["config"]["destinations"]) == (2, 2)
    assert len(summary["curve_minutes"]) == 1
    assert summary["model"] == str(folder)
    assert sorted(file.name for file in folder.iterdir()) == ["checkpoint.eqx", "model.eqx"]


def test_compare_takes_a_model_of_a_level(sidestep, local_model):
    args = ("compare", "paper-congested", "--walks", 3, "--model", local_model[0], "--level", "local")
    done = sidestep(*args, "--planners", "darp,greedy-local", "--by", 60, "--against", "greedy-local", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["baseline"], found["by_minutes"], found["maps"]) == ("greedy-local", 60, 1)
    rows = found["planners"]
    assert set(rows) == {"darp", "greedy-local", "shortest-path", "expected", "clairvoyant"}
    assert rows["darp"]["level"] == rows["greedy-local"]["level"] == "local"
    assert rows["greedy-local"]["difference_minutes"] == 0
    for row in rows.values():
        assert 0 <= row["arrive_by"] <= row["arrival_rate"]
    table = sidestep(*args, "--planners", "darp", "--by", 60)
    assert table.returncode == 0, table.stderr
    assert "within 60" in table.stdout
    assert "over expected" in table.stdout


def test_route_plans_a_walk_and_says_how_long_it_may_take(sidestep):
    args = ("route", "paper-congested", "--futures", 20)
    done = sidestep(*args, "--by", 90, "--depart", 5, "--from", 7, "--to", 9, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    found = json.loads(done.stdout)
    assert (found["planner"], found["level"], found["futures"], found["by_minutes"]) == ("expected", "map", 20, 90)
    assert (found["nodes"][0], found["nodes"][-1], found["arrives"]) == (7, 9, True)
    assert found["minutes"][0] == 0
    assert found["minutes"] == sorted(found["minutes"])
    assert found["minutes"][-1] == pytest.approx(found["expected_minutes"], abs=0.01)
    assert 200 <= found["metres"] <= 1000 * (len(found["nodes"]) - 1)  # streets of 100 m at least, two at least
    assert found["median_minutes"] <= found["p90_minutes"]
    assert 0 <= found["arrive_by"] <= found["arrival_rate"] <= 1
    table = sidestep(*args)
    assert table.returncode == 0, table.stderr
    assert "expected (map), departing 0 min after the start, if crowds are as expected" in " ".join(
        table.stdout.split()
    )
    assert "In 20 simulated futures: median" in table.stdout
    assert "with probability" not in table.stdout  # nobody asked


def test_route_takes_a_model(sidestep, model, local_model):
    folder, _ = local_model
    args = ("route", "paper-congested", "--futures", 10, "--model")
    done = sidestep(*args, folder, "--by", 60, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["planner"], found["level"], found["nodes"][0]) == ("darp", "local", 0)
    assert 0 <= found["arrive_by"] <= found["arrival_rate"]
    # The model remembers map 0 of seed 0, and has learned to walk to 35 and to another node, but not to the origin.
    assert f"the model in {folder} remembers map 0, not 1" in one_sentence(sidestep(*args, folder, "--map", 1))
    assert "this map is another of as many" in one_sentence(sidestep(*args, folder, "--seed", 1))
    said = one_sentence(sidestep(*args, folder, "--to", 0))
    assert re.search(r" remembers how to walk to \d+, 35, not to 0", said)
    assert "this map is one of 36 nodes" in one_sentence(sidestep(*args, model))


def test_interrupted_training_keeps_its_checkpoint(environ, tmp_path):
    folder = tmp_path / "m"
    command = [sys.executable, "-m", "sidestep", "train", "paper-unblocked", "--rounds", "100000", "--out", str(folder)]
    # A child inherits ignored signals (a job in the background ignores interrupts), but never a handler of ours.
    # (Not by `preexec_fn`: that forks, and JAX warns of forks.)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        process = subprocess.Popen(command, env=environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    written_last = folder / "model.eqx"
    deadline = time.monotonic() + 120
    while not written_last.exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.startswith("sidestep: stopped")
    assert len(err.splitlines()) == 1
    assert out == ""
    assert sorted(file.name for file in folder.iterdir()) == ["checkpoint.eqx", "model.eqx"]
    from sidestep.agent import checkpoint

    assert len(checkpoint.load(folder).curve) >= 1
    assert len(checkpoint.load_model(folder).curve) >= 1


def test_reproduce_quick_writes_everything(sidestep, agreed_row, tmp_path):
    out = tmp_path / "r"
    done = sidestep("reproduce", "--quick", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    results = json.loads((out / "results.json").read_text())
    assert results == json.loads(done.stdout)
    for key in ("unblocked", "congested", "unblocked_forecast", "congested_forecast"):
        assert set(results[key]["planners"]["darp"]) >= agreed_row
        assert results[key]["planners"]["darp"]["arrival_rate"] == 1.0
        assert (out / f"{key.replace('_', '-')}.png").read_bytes().startswith(b"\x89PNG")
    # About one training in forty ends 2 % off on its map.
    assert results["congested_forecast"]["planners"]["darp"]["regret"] <= 0.02
    report = (out / "report.html").read_text()
    for number in ("37.3", "52.1", "65.3", "-67", "-75", "after 5,000 steps"):
        assert number in report
    assert 'src="data:image/png;base64,' in report
    assert not re.search(r'(src|href)="(?!data:)', report)  # nothing outside the file


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("compare", "paper-congestd"), "did you mean paper-congested"),
        (("train",), "SCENARIO"),
        (("compare", "paper-congested", "--maps", "many"), "--maps: 'many' is not a whole number"),
        (("counts", "--sensor", "45 Quen Street"), "45 Queen Street"),
    ],
)
def test_bad_input_gets_one_sentence(sidestep, args, says, tmp_path):
    assert says in one_sentence(sidestep(*args, cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ("train nowhere", "unknown scenario 'nowhere'"),
        ("compare paper-congested --maps -1", "--maps must be at least 1, not -1"),
        ("compare paper-congested --walks 0", "--walks must be at least 1, not 0"),
        ("compare paper-congested --workers 0", "--workers must be at least 1, not 0"),
        ("compare paper-congested --side -3", "side must be at least 2 nodes, not -3"),
        ("compare paper-congested --crowded-nodes -1", "crowded nodes must be between 0 and 34"),
        ("compare paper-congested --planners astar", "unknown planner 'astar'"),
        ("compare paper-congested --model no/such/folder", "no model in no/such/folder"),
        ("compare paper-congested --seed -1", "--seed must be at least 0, not -1"),
        ("train paper-congested --rounds 0", "rounds must be at least 1, not 0"),
        ("train paper-congested --gamma 1.5", "gamma must lie between 0 and 1, not 1.5"),
        ("train paper-congested --map -1", "--map must be at least 0, not -1"),
        ("reproduce --maps 0", "--maps must be at least 1, not 0"),
        ("walk", "walk"),
        ("train paper-congested --speed 3", "--speed"),
        ("train paper-congested --rounds 1.5", "--rounds: '1.5' is not a whole number"),
        ("train paper-congested --gamma nan", "gamma must lie between 0 and 1, not nan"),
        ("train paper-congested --level hindsight", "--level"),
        ("train rush-16 --preset paper", "the preset paper knows the walker's position alone"),
        ("counts no-such-file.csv", "no-such-file.csv"),
        ("route paper-congestd", "did you mean paper-congested"),
        ("compare paper-congested --by 0", "--by must be a positive number of minutes, not 0"),
        ("compare paper-congested --by nan", "--by must be a positive number of minutes, not nan"),
        ("compare paper-congested --against astar", "unknown planner 'astar'"),
        ("compare unseen-maps --level position", "coordinates mean nothing on maps that were never walked"),
        ("train paper-congested --preset tabular-q --level map", "the preset tabular-q knows the walker's position"),
        ("train unseen-maps --level position", "coordinates mean nothing on maps that were never walked"),
        ("train paper-congested --n-step 0", "n_step must be at least 1, not 0"),
        ("train paper-congested --n-step 41", "n_step must be at most the 40 iterations of a round, not 41"),
        ("train paper-congested --destinations 0", "goals must be at least 1, not 0"),
        (
            "train paper-congested --level local --destinations 36",
            "there must be between 1 and 35 destinations, not 36",
        ),
        ("train rush-16 --level live --destinations 3", "at level live goals must divide the"),
    ],
)
def test_more_bad_input_is_refused(args, says, monkeypatch, tmp_path):
    # As above, in this process, which takes seconds less for each; what `main` makes of errors is seen above.
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    monkeypatch.chdir(tmp_path)
    with pytest.raises((SidestepError, CycloptsError)) as caught:
        cli.app(args.split(), exit_on_error=False, print_error=False)
    said = str(caught.value)
    assert says in said
    assert "\n" not in said or isinstance(caught.value, CycloptsError)  # whose lines `main` joins
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content", [b"", b"time\n", b"time,a\n2024-01-01T00,-5\n", b"\xff\xfe\x00", b"<html></html>\n"]
)
def test_malformed_counts_name_the_file(monkeypatch, content, tmp_path):
    monkeypatch.setattr(cli, "_start_jax", lambda: None)
    (tmp_path / "c.csv").write_bytes(content)
    with pytest.raises(SidestepError) as caught:
        cli.app(["counts", str(tmp_path / "c.csv")], exit_on_error=False, print_error=False)
    assert "c.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("command", [("demo",), ("reproduce", "--quick"), ("train", "paper-congested")])
def test_output_folder_that_cannot_be_written(sidestep, command, tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("here first")
    assert "cannot write" in one_sentence(sidestep(*command, "--out", in_the_way / "out"))
    assert in_the_way.read_text() == "here first"


def test_counts_of_an_own_file(sidestep, tmp_path):
    hours = [f"2024-{month:02}-{day:02}T{hour:02}" for month in (1, 2) for day in range(1, 29) for hour in range(24)]
    hours = [hour for hour in hours if hour < "2024-01-29"]
    rows = [f"{hour},{100 + 50 * (int(hour[-2:]) % 12) + (i * 37) % 23}" for i, hour in enumerate(hours)]
    (tmp_path / "c.csv").write_text("time,bridge\n" + "\n".join(rows) + "\n")
    done = sidestep("counts", "c.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["sensor"] == "bridge"
    assert found["hours"] == 28 * 24
    assert all(error > 0 for error in found["rmse"].values())


def test_damaged_models_are_refused(sidestep, model, tmp_path):
    whole = (model / "model.eqx").read_bytes()
    line, numbers = whole.split(b"\n", 1)
    other = json.loads(line) | {"format": 99}
    cases = {
        "cut short": whole[: len(whole) // 2],
        "is not a Sidestep model": b"\x00\x01\x02",
        "model format 99": json.dumps(other).encode() + b"\n" + numbers,
    }
    for number, (says, content) in enumerate(cases.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "model.eqx").write_bytes(content)
        said = one_sentence(sidestep("compare", "paper-congested", "--model", folder))
        assert says in said
        assert str(folder) in said


def test_no_half_written_file(tmp_path):
    from sidestep.files import whole_file

    target = tmp_path / "results.json"
    target.write_text("old")

    def fail_half_way():
        with whole_file(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_half_way()
    assert target.read_text() == "old"
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]
