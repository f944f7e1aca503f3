"""The command line as people use it: real training, real files, and real processes where they are the point."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from sidestep.agent import memory, runs
from sidestep.cli import app as cli
from sidestep.errors import SidestepError
from sidestep.experiments import demo, paper

GRID = ("paper-congested", "--side", 3, "--crowded-nodes", 1)
COMPARE = ("compare", *GRID, "--walks", 3)  # as many walks everywhere, so that compiled programs serve again
SEARCH = {
    "random-walk", "random-progress", "shortest-path", "expected", "clairvoyant", "greedy-local", "lrta-star",
    "greedy-map", "snapshot", "forecast",
}  # fmt: skip
WITH_SEED = ("demo", "reproduce", "train", "compare", "route", "trade-off", "counts")
WITHOUT_SEED = ("import-osm", "new", "planners", "runs", "scenarios", "walkers")


@pytest.fixture(scope="session")
def model(sidestep, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "m"
    done = sidestep("train", *GRID, "--out", folder)  # as comparisons train their own agents
    assert done.returncode == 0, done.stderr
    assert "\nthe paper's 5 x 5 blocks, all segments at four nodes crowded by 5,000 people\n" in done.stdout
    assert "; the mean network of the last quarter of rounds is kept\n" in done.stdout
    assert f"\nLearning curve: {folder / 'learning-curve.png'}\n" in done.stdout
    return folder


@pytest.fixture(scope="session")
def local_model(sidestep, tmp_path_factory):
    """Of level local; to node 8 and one other."""
    folder = tmp_path_factory.mktemp("models") / "local"
    args = ("train", *GRID, "--rounds", 1, "--level", "local", "--n-step", 2, "--destinations", 2)
    done = sidestep(*args, "--out", folder, "--json")
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def one_sentence(done, status=2):
    assert done.returncode == status, (done.returncode, done.stdout, done.stderr)
    assert done.stderr.startswith("sidestep: ")
    assert len(done.stderr.splitlines()) == 1
    assert "Traceback" not in done.stderr + done.stdout
    return done.stderr


def test_help_names_all_commands_and_each_has_help(sidestep):
    done = sidestep("--help")
    assert done.returncode == 0
    for command in (*WITH_SEED, *WITHOUT_SEED):
        assert re.search(rf"\b{command}\b", done.stdout)
        said = sidestep(command, "--help").stdout
        assert "--json" in said
        assert ("--seed" in said) == (command in WITH_SEED)


@pytest.mark.parametrize("command", [(name,) for name in (*WITH_SEED, *WITHOUT_SEED)] + [("counts", "import")])
def test_help_says_what_every_option_is(command):
    app = cli.app
    for name in command:
        app = app[name]
    shown = [argument for argument in app.assemble_argument_collection(parse_docstring=True) if argument.show]
    assert shown
    assert [argument.name for argument in shown if not argument.parameter.help] == []


def test_help_loads_nothing_heavy():
    # So that it is there at once: 0.3 s on a quiet machine.
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys, sidestep.cli.app; print(*sys.modules)"], capture_output=True, text=True
    ).stdout.split()
    heavy = {"jax", "numpy", "pandas", "matplotlib", "statsmodels", "equinox", "optax", "scipy", "pydantic", "shapely"}
    assert "sidestep.cli.route" in loaded
    assert not heavy & set(loaded)


def test_planners_scenarios_and_walkers_are_listed(sidestep):
    found = {name: json.loads(sidestep(name, "--json").stdout) for name in ("planners", "scenarios", "walkers")}
    for name, entries in found.items():
        table = sidestep(name)
        assert table.returncode == 0, table.stderr
        for entry in entries:
            assert re.search(rf"^ +{re.escape(entry['name'])} ", table.stdout, re.MULTILINE)
            assert entry["summary"]
    assert {"expected", "darp"} < {entry["name"] for entry in found["planners"]}
    (expected,) = (entry for entry in found["planners"] if entry["name"] == "expected")
    assert expected.keys() == {"name", "level", "learns", "summary", "use"}
    (wheelchair,) = (entry for entry in found["walkers"] if entry["name"] == "wheelchair")
    assert (wheelchair["free_speed"], wheelchair["stairs"]) == (0.79, False)
    assert "0.79 m/s" in sidestep("walkers").stdout
    (helsinki,) = (entry for entry in found["scenarios"] if entry["name"] == "helsinki")
    assert "demand 120 × the counts" in helsinki["synthetic"]
    assert "demand 120 × the counts" in " ".join(sidestep("scenarios").stdout.split())


def test_a_planner_of_the_users_walks_in_compare_and_route(sidestep, process, monkeypatch, tmp_path):
    (tmp_path / "e2e_mine.py").write_text(
        "from sidestep.planners.time_dependent import Expected\n\n\n"
        'class Optimist(Expected):\n    """Hope that crowds come as expected."""\n\n    name = \'e2e-optimist\'\n'
    )
    # Modules in the current folder are found.
    said = one_sentence(process("compare", "paper-congested", "--planners", "e2e_mine:Pessimist", cwd=tmp_path))
    assert "'e2e_mine' has no attribute 'Pessimist'" in said
    monkeypatch.syspath_prepend(str(tmp_path))
    done = sidestep(*COMPARE, "--planners", "e2e_mine:Optimist", "--maps", 2, "--json")
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["planners"]
    assert list(rows) == ["shortest-path", "expected", "clairvoyant", "e2e-optimist"]
    assert rows["e2e-optimist"] == rows["expected"]
    done = sidestep("route", *GRID, "--planner", "e2e_mine:Optimist", "--futures", 10, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["planner"] == "e2e-optimist"


def test_compare_prints_the_agreed_shape(sidestep, agreed_row):
    done = sidestep(*COMPARE, "--maps", 1, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # no bar where there is no terminal
    found = json.loads(done.stdout)
    assert (found["scenario"], found["maps"], found["walks"], found["seed"]) == ("paper-congested", 1, 3, 0)
    assert set(found["planners"]) == {*SEARCH, "darp"}
    assert (found["baseline"], found["by_minutes"]) == ("expected", None)
    for row in found["planners"].values():
        assert set(row) >= agreed_row
        assert row["gap"] >= -1e-4
        assert row["ci95"][0] <= row["mean_minutes"] <= row["ci95"][1]
    assert found["planners"]["shortest-path"]["saving_vs_shortest_path"] == 0
    assert found["planners"]["clairvoyant"]["gap"] == 0


def test_compare_takes_several_walkers(sidestep, monkeypatch):
    args = (*COMPARE, "--maps", 1, "--planners", "expected", "--law", "weidmann", "--walker")
    done = sidestep(*args, "adult,older,free_speed=0.67,robot", "--json")
    assert done.returncode == 0, done.stderr
    adult, older, robot = json.loads(done.stdout)
    assert (adult["walker"], older["walker"]["kind"], robot["walker"]["kind"]) == (None, "older", "robot")
    assert older["walker"]["free_speed"] == 0.67
    minutes = [each["planners"]["clairvoyant"]["mean_minutes"] for each in (adult, older, robot)]
    assert minutes[0] < minutes[1]
    alone = json.loads(sidestep(*args, "adult", "--json").stdout)
    assert alone == adult
    monkeypatch.setenv("COLUMNS", "200")
    table = sidestep(*args, "adult,older,free_speed=0.67,robot").stdout
    assert "walker: older (0.67 m/s)" in table
    for walker in ("adult", "older", "robot"):
        assert len(re.findall(rf"^ +{walker} +", table, re.MULTILINE)) == 3  # planners
    # Two of one kind are told apart by their numbers.
    table = sidestep(*args, "older,older,free_speed=0.67").stdout
    assert {"older (1.16 m/s)", "older (0.67 m/s)"} <= set(re.findall(r"^ +(older \(.*?\)) ", table, re.MULTILINE))


def test_compare_writes_single_walks(sidestep, model, tmp_path):
    out = tmp_path / "new" / "walks.csv"
    args = (*COMPARE, "--maps", 1, "--planners", "expected", "--walker", "adult,older", "--walks-out")
    done = sidestep(*args, out, "--law", "weidmann")
    assert done.returncode == 0, done.stderr
    assert f"Walks: {out}" in done.stdout
    table = tmp_path / "results.parquet"
    found = json.loads(sidestep(*args, out, "--law", "weidmann", "--results-out", table, "--json").stdout)
    rows = pd.read_parquet(table)
    assert rows["mean_minutes"].tolist() == [row["mean_minutes"] for each in found for row in each["planners"].values()]
    lines = out.read_text().splitlines()
    assert len(lines) == 1 + 2 * 3 * 3  # walkers, planners, walks
    assert len({line.split(",")[1] for line in lines[1:]}) == 2
    before = {file.name: file.read_bytes() for file in model.iterdir()}
    for name in ("model.eqx", "walks.txt"):
        args = ["compare", *map(str, GRID), "--model", str(model), "--walks-out", str(model / name)]
        with pytest.raises(SidestepError) as caught:
            cli.app(args, exit_on_error=False, print_error=False)
        assert caught.value.field == "walks_out"
        args[args.index("--walks-out")] = "--results-out"
        with pytest.raises(SidestepError) as caught:
            cli.app(args, exit_on_error=False, print_error=False)
        assert caught.value.field == "results_out"
    args = [
        "compare",
        *map(str, GRID),
        "--walks-out",
        str(out / "a.csv"),
        "--results-out",
        str(out / "b" / ".." / "a.csv"),
    ]
    with pytest.raises(SidestepError) as caught:
        cli.app(args, exit_on_error=False, print_error=False)
    assert caught.value.field == "results_out"
    assert {file.name: file.read_bytes() for file in model.iterdir()} == before


def test_the_same_seed_gives_the_same_numbers(sidestep):
    args = (*COMPARE, "--maps", 2, "--planners", "random-walk,expected", "--json")

    def minutes(*more):
        rows = json.loads(sidestep(*args, *more).stdout)["planners"]
        return {name: row["mean_minutes"] for name, row in rows.items()}

    assert minutes("--workers", 1) == minutes("--workers", 2)
    assert minutes() != minutes("--seed", 1)


def test_demo_writes_a_picture(sidestep, monkeypatch, tmp_path):
    # What three rounds learn and five walks meet is enough to draw.
    monkeypatch.setattr(demo, "CONFIG", demo.CONFIG.changed(rounds=3))
    monkeypatch.setattr(demo, "WALKS", 5)
    done = sidestep("demo", "--out", tmp_path / "d")
    assert done.returncode == 0, done.stderr
    assert "darp" in done.stdout
    assert (tmp_path / "d" / "map.png").read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in (tmp_path / "d").iterdir()] == ["map.png"]


def test_trade_off_draws_a_picture(sidestep, tmp_path):
    picture = tmp_path / "new" / "t.png"
    args = ("trade-off", *GRID, "--weights", "5,0", "--walks", 3, "--planners", "shortest-path", "--out", picture)
    done = sidestep(*args, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert (found["picture"], found["attribution"]) == (str(picture), "")
    ((name, points),) = found["curves"].items()
    assert (name, [point["weight"] for point in points]) == ("shortest-path", [0, 5])
    # This planner's walks do not depend on the weight.
    assert points[0] | {"weight": None} == points[1] | {"weight": None} == found["shortest_path"]
    table = sidestep(*args)
    assert table.returncode == 0, table.stderr
    assert f"{points[0]['exposure']:,.0f}" in table.stdout
    assert " 100.0 %" in table.stdout
    assert str(picture) in table.stdout


def test_train_resumes_where_it_was(sidestep, model):
    args = ("train", *GRID, "--json")
    straight = json.loads(sidestep(*args).stdout)
    assert (len(straight["curve_minutes"]), straight["picture"]) == (40, None)
    before = {file.name: file.read_bytes() for file in model.iterdir()}
    assert "--overwrite" in one_sentence(sidestep(*args, "--out", model))
    assert "exclude" in one_sentence(sidestep(*args, "--out", model, "--resume", "--overwrite"))
    assert "--out" in one_sentence(sidestep(*args, "--overwrite"))
    assert {file.name: file.read_bytes() for file in model.iterdir()} == before
    assert "--rounds" in one_sentence(sidestep(*args, "--out", model, "--resume"))
    assert "seed" in one_sentence(sidestep(*args, "--out", model, "--resume", "--seed", 5))
    assert "--out" in one_sentence(sidestep(*args, "--resume"))


def test_the_learning_curve_is_drawn_of_what_there_is(sidestep, monkeypatch, tmp_path):
    args = ("train", *GRID, "--preset", "tabular-q", "--rounds", 3, "--out", tmp_path)
    picture, saved = tmp_path / "learning-curve.png", []

    def once(run, folder, keep):
        if saved:
            raise KeyboardInterrupt
        saved.append(folder)
        save(run, folder, keep)

    save = runs.save
    monkeypatch.setattr(runs, "SAVE_SECONDS", 0.0)
    monkeypatch.setattr(runs, "save", once)
    assert "stopped" in one_sentence(sidestep(*args), status=130)
    unfinished = picture.read_bytes()
    assert unfinished.startswith(b"\x89PNG")
    monkeypatch.setattr(runs, "save", save)
    done = sidestep(*args, "--resume")
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes() != unfinished  # all rounds, also those of before
    assert f"Learning curve: {picture}" in done.stdout


def test_compare_takes_a_trained_model(sidestep, model):
    args = (*COMPARE, "--model", model)
    done = sidestep(*args, "--planners", "expected", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["maps"] == 1
    assert found["planners"]["darp"]["level"] == "position"
    # A model walks whether it is named or not.
    assert list(found["planners"]) == ["shortest-path", "expected", "clairvoyant", "darp"]
    # It remembers the 9 nodes of a map.
    said = one_sentence(sidestep("compare", "paper-unblocked", "--model", model))
    assert str(model) in said
    assert "36 nodes" in said
    for more in (("--seed", 7), ("--level", "local"), ("--objective", "distance"), ("--walker", "older")):
        assert str(model) in one_sentence(sidestep(*args, *more))
    assert "--maps" in one_sentence(sidestep(*args, "--maps", 1))


def test_a_level_is_trained_and_said(local_model):
    folder, summary = local_model
    assert (summary["level"], summary["config"]["level"], summary["map"]) == ("local", "local", 0)
    assert (summary["config"]["n_step"], summary["config"]["destinations"]) == (2, 2)
    assert len(summary["curve_minutes"]) == 1
    assert (summary["model"], summary["picture"]) == (str(folder), str(folder / "learning-curve.png"))
    assert sorted(file.name for file in folder.iterdir()) == [
        "checkpoint-1.eqx", "learning-curve.png", "metrics.jsonl", "model.eqx",
    ]  # fmt: skip


def test_compare_takes_a_model_of_a_level(sidestep, local_model):
    args = (*COMPARE, "--model", local_model[0], "--level", "local", "--by", 60, "--against", "greedy-local")
    done = sidestep(*args, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["baseline"], found["by_minutes"], found["maps"]) == ("greedy-local", 60, 1)
    rows = found["planners"]
    assert set(rows) == {*SEARCH, "darp"}
    assert rows["darp"]["level"] == rows["greedy-local"]["level"] == "local"
    assert rows["greedy-local"]["difference_minutes"] == 0
    for row in rows.values():
        assert 0 <= row["arrive_by"] <= row["arrival_rate"]
    table = sidestep(*args)
    assert table.returncode == 0, table.stderr
    assert "within 60 min" in table.stdout
    assert "over greedy-local" in table.stdout


def test_route_plans_a_walk_and_says_how_long_it_may_take(sidestep):
    args = ("route", *GRID, "--futures", 10)
    done = sidestep(*args, "--by", 90, "--depart", 5, "--from", 1, "--to", 5, "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    found = json.loads(done.stdout)
    assert (found["planner"], found["level"], found["futures"], found["by_minutes"]) == ("expected", "map", 10, 90)
    assert (found["nodes"][0], found["nodes"][-1], found["arrives"]) == (1, 5, True)
    assert found["minutes"][0] == 0
    assert found["minutes"] == sorted(found["minutes"])
    assert found["minutes"][-1] == pytest.approx(found["expected_minutes"], abs=0.01)
    assert 200 <= found["metres"] <= 1000 * (len(found["nodes"]) - 1)  # streets of 100 m at least, two at least
    assert found["median_minutes"] <= found["p90_minutes"]
    assert 0 <= found["arrive_by"] <= found["arrival_rate"] <= 1
    table = sidestep(*args)
    assert table.returncode == 0, table.stderr
    assert "expected (map), departing 0 min after the start" in " ".join(table.stdout.split())
    assert "In 10 simulated futures: median" in table.stdout
    assert "with probability" not in table.stdout  # nobody asked


def test_route_takes_a_model(sidestep, model, local_model):
    folder, _ = local_model
    args = ("route", *GRID, "--futures", 10, "--model")
    done = sidestep(*args, folder, "--by", 60, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["planner"], found["level"], found["nodes"][0]) == ("darp", "local", 0)
    assert 0 <= found["arrive_by"] <= found["arrival_rate"]
    # The model remembers map 0 of seed 0, and has learned to walk to 8 and to another node, but not to the origin.
    for more in (("--map", 1), ("--seed", 1)):
        assert "remembers" in one_sentence(sidestep(*args, folder, *more))
    said = one_sentence(sidestep(*args, folder, "--to", 0))
    assert re.search(r"\d, 8, not to 0", said)
    assert "36 nodes" in one_sentence(sidestep("route", "paper-congested", "--model", model))


def test_interrupted_training_keeps_its_checkpoint(environ, tmp_path):
    folder = tmp_path / "m"
    endless = ("--preset", "tabular-q", "--rounds", "100000")  # tables take less compiling than networks
    command = [sys.executable, "-m", "sidestep", "train", "paper-unblocked", *endless, "--out", str(folder)]
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
    from sidestep.agent import checkpoint

    kept = [path.name for path in checkpoint.checkpoints(folder)]
    assert 1 <= len(kept) <= 2
    assert {file.name for file in folder.iterdir()} == {*kept, "learning-curve.png", "metrics.jsonl", "model.eqx"}
    assert len(checkpoint.load(folder).metadata.curve) >= 1
    assert len(checkpoint.load_model(folder).metadata.curve) >= 1


def test_reproduce_that_is_refused_leaves_no_folder(tmp_path):
    args = ["reproduce", "--quick", "--out", str(tmp_path / "r"), "--results-out", str(tmp_path / "x.txt")]
    with pytest.raises(SidestepError) as caught:
        cli.app(args, exit_on_error=False, print_error=False)
    assert caught.value.field == "results_out"
    assert list(tmp_path.iterdir()) == []


def test_reproduce_writes_everything(sidestep, agreed_row, monkeypatch, tmp_path):
    # Rounds and walks as in the demonstration above, so that compiled programs serve both.
    monkeypatch.setattr(paper, "QUICK", paper.Plan(maps=2, literal_maps=1, rounds=3, literal_rounds=1, walks=5))
    out = tmp_path / "r"
    table = tmp_path / "results.parquet"
    command = ("reproduce", "--quick", "--out", out, "--results-out", table, "--workers", 1, "--json")
    done = sidestep(*command)
    assert done.returncode == 0, done.stderr
    results = json.loads((out / "results.json").read_text())
    assert results == json.loads(done.stdout)
    # Nothing that is done is done again, and nothing is mixed with it.
    before = {job: job.stat().st_mtime_ns for job in out.glob("jobs/*/result.json")}
    assert len(before) == 4 * (2 + 2 + 1)
    assert json.loads(sidestep(*command).stdout) == results
    assert {job: job.stat().st_mtime_ns for job in before} == before
    assert "rule" in one_sentence(sidestep(*command, "--rule", "entry"))
    for key in ("unblocked", "congested", "unblocked_forecast", "congested_forecast"):
        rows = results[key]["planners"]
        assert set(rows) == {*paper.PLANNERS, "darp", "darp-paper"}
        assert set(rows["darp"]) >= agreed_row
        assert (rows["darp"]["maps"], rows["darp-paper"]["maps"]) == (2, 1)
        assert {name: len(curve) for name, curve in results["curves"][key].items()} == {"darp": 3, "darp-paper": 1}
        assert (out / f"{key.replace('_', '-')}.png").read_bytes().startswith(b"\x89PNG")
    read = pd.read_parquet(table).set_index(["scenario", "flows", "planner"])["gap"]
    assert len(read) == 4 * 7
    assert read["paper-congested", "forecast", "darp"] == results["congested_forecast"]["planners"]["darp"]["gap"]
    assert [claim["verdict"] for claim in results["claims"]] == ["not judged"] * 7  # by two maps
    report = (out / "report.html").read_text()
    for number in ("37.3", "52.1", "65.3", "-67", "-75", "after 1,000 steps"):
        assert number in report
    assert report.count('src="data:image/png;base64,') == 4
    assert report.count('<td class="text not judged">not judged</td>') == 7


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (("compare", "paper-congestd"), "paper-congested"),
        (("compare", "paper-congested", "--maps", "many"), "--maps"),
    ],
)
def test_bad_input_gets_one_sentence(process, args, says, tmp_path):
    assert says in one_sentence(process(*args, cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []


# Options, and a word that the sentence has to mention.
@pytest.mark.parametrize(
    ("args", "says"),
    [
        ("train", "SCENARIO"),
        ("train nowhere", "nowhere"),
        ("train paper-congested --rounds 0", "rounds"),
        ("train paper-congested --rounds 1.5", "--rounds"),
        ("train paper-congested --gamma 1.5", "gamma"),
        ("train paper-congested --gamma nan", "gamma"),
        ("train paper-congested --map -1", "--map"),
        ("train paper-congested --speed 3", "--speed"),
        ("train paper-congested --level hindsight", "--level"),
        ("train paper-congested --preset tabular-q --level map", "tabular-q"),
        ("train paper-congested --n-step 0", "n_step"),
        ("train paper-congested --n-step 41", "n_step"),
        ("train paper-congested --destinations 0", "0"),
        ("train paper-congested --level local --destinations 36", "36"),
        ("train rush-16 --preset paper", "paper"),
        ("train unseen-maps --level position", "level"),
        ("compare paper-congestd", "paper-congested"),
        ("compare paper-congested --maps -1", "--maps"),
        ("compare paper-congested --walks 0", "--walks"),
        ("compare paper-congested --workers 0", "--workers"),
        ("compare paper-congested --side -3", "-3"),
        ("compare paper-congested --crowded-nodes -1", "-1"),
        ("compare paper-congested --planners astar", "astar"),
        ("compare paper-congested --against astar", "astar"),
        ("compare paper-congested --model no/such/folder", "no/such/folder"),
        ("compare paper-congested --seed -1", "--seed"),
        ("compare paper-congested --by 0", "--by"),
        ("compare paper-congested --by nan", "--by"),
        ("compare paper-congested --walker dog", "dog"),
        ("compare paper-congested --walker adult,adult", "different walkers"),
        ("compare paper-congested --walker custom", "free_speed"),
        ("compare paper-congested --walker older,free_speed=fast", "fast"),
        ("route paper-congested --walker adult,older", "adult,older"),
        ("train paper-congested --walker adult,older", "adult,older"),
        ("compare unseen-maps --level position", "level"),
        ("reproduce --maps 0", "--maps"),
        ("trade-off paper-congested --planners darp", "darp"),
        ("trade-off paper-congested --planners astar", "astar"),
        ("trade-off paper-congested --weights 1,1", "weights"),
        ("trade-off paper-congested --weights 1,nan", "--weights"),
        ("trade-off paper-congested --weights=-1,1", "-1"),
        ("trade-off paper-congested --walks 0", "--walks"),
        ("trade-off paper-congested --out picture.jpg", "--out"),
        ("route helsinki --depart 2025-05-24 17:30", '--depart "2025-05-24 17:30"'),
        ("when helsinki --depart=Fri 17:30", '--depart "Fri 17:30"'),
        ("when helsinki --depart 17:30 --until Fri 19:30", '--until "Fri 19:30"'),
        ("route helsinki --arrive-by Sat 9:05:00", '--arrive-by "Sat 9:05:00"'),
        ("crowds helsinki --at Sat 9:05", '--at "Sat 9:05"'),
        ("walk", "walk"),
        ("counts no-such-file.csv", "no-such-file.csv"),
        ("route paper-congestd", "paper-congested"),
    ],
)
def test_more_bad_input_is_refused_in_one_sentence(sidestep, args, says, tmp_path):
    assert says in one_sentence(sidestep(*args.split(), cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_a_training_that_does_not_fit_into_memory_is_refused_in_one_sentence(sidestep, monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "bytes_available", lambda: 1000)
    done = sidestep("train", *GRID, "--out", tmp_path / "m")
    assert (done.returncode, done.stderr.count("\n"), list(tmp_path.iterdir())) == (2, 1, [])
    assert " GB" in done.stderr


@pytest.mark.parametrize("option", ["maps", "walks", "workers", "seed", "by"])
def test_refused_options_are_fields_of_the_error(option):
    with pytest.raises(SidestepError) as caught:
        cli.app(["compare", "paper-congested", f"--{option}", "-1"], exit_on_error=False, print_error=False)
    assert caught.value.field == option


@pytest.mark.parametrize(
    "content", [b"", b"time\n", b"time,a\n2024-01-01T00,-5\n", b"\xff\xfe\x00", b"<html></html>\n"]
)
def test_malformed_counts_name_the_file(sidestep, content, tmp_path):
    (tmp_path / "c.csv").write_bytes(content)
    assert "c.csv" in one_sentence(sidestep("counts", tmp_path / "c.csv"))


@pytest.mark.parametrize("command", [("demo",), ("reproduce", "--quick"), ("train", "paper-congested")])
def test_output_folder_that_cannot_be_written(sidestep, command, tmp_path):
    in_the_way = tmp_path / "file"
    in_the_way.write_text("here first")
    assert "cannot write" in one_sentence(sidestep(*command, "--out", in_the_way / "out"))
    assert in_the_way.read_text() == "here first"


@pytest.mark.parametrize(
    "command",
    [
        "demo --out a/b/c",
        "reproduce --quick --out a/b/c",
        "train paper-congested --out a/b/c",
        "trade-off paper-congested --out a/b/c.png",
        "route paper-congested --out a/b/c.json",
        "when paper-congested --out a/b/c.json",
        "isochrone paper-congested --out a/b/c.json",
        "matrix paper-congested --from 0 --out a/b/c.json",
        "crowds paper-congested --out a/b/c.json",
        "counts --out a/b/c.csv",
        "counts import none.csv --network helsinki --out a/b/c.npz",
        "import-osm none.osm --out a/b/c.npz",
    ],
)
def test_folders_above_the_last_one_are_not_made(sidestep, command, tmp_path):
    assert "there is no folder a;" in one_sentence(sidestep(*command.split(), cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []


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


def test_a_scenario_of_counts_that_know_their_places(sidestep, tmp_path):
    begins = 1709251200  # 2024-03-01T00:00 in UTC
    rows = [f"{begins + 3600 * hour},{hour % 24},60.1700,24.9400" for hour in range(24 * 7 * 9)]
    (tmp_path / "c.csv").write_text("\n".join(["timestamp,Many,y,x", *rows, ""]))
    named = ("--counts", "c.csv", "--columns", "count=Many,latitude=y,longitude=x", "--timezone", "Europe/Helsinki")
    half = sidestep("new", "town", "--counts", "c.csv", "--columns", "count=Many,latitude=y", cwd=tmp_path)
    assert "longitude" in one_sentence(half)
    done = sidestep("new", "town", *named, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["sensors"], found["at_their_places"]) == (1, 1)
    assert "SYNTHETIC" not in (tmp_path / "town" / "scenario.toml").read_text()
    done = sidestep("crowds", "town/scenario.toml", "--at", "Fri 17:30", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["synthetic"] == ""


def test_counts_of_a_publisher_are_understood_and_written(sidestep, tmp_path):
    times = [
        f"March {day:02}, 2024 {hour % 12 or 12}:00 {'AP'[hour // 12]}M" for day in range(1, 29) for hour in range(24)
    ]
    cells = [f"{time},{where},{100 * (i % 24 >= 12)}" for i, time in enumerate(times) for where in ("Hall", "Quay")]
    (tmp_path / "c.csv").write_text("\n".join(["When,Where,Many", *cells, ""]))
    assert "'When'" in one_sentence(sidestep("counts", "c.csv", cwd=tmp_path))
    named = ("counts", "c.csv", "--columns", "time=When,sensor=Where", "--columns", "count=Many")
    done = sidestep(*named, "--out", "clean/c.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["hours"], found["sensors"], found["repairs"]) == (28 * 24, ["Hall", "Quay"], [])
    assert any("'Where'" in said for said in found["understood"])
    assert (tmp_path / "clean" / "c.csv").read_text().startswith("time,Hall,Quay\n2024-03-01T00:00,0,0\n")
    # A square wave is fitted: all weeks are alike.
    done = sidestep("counts", "clean/c.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert max(json.loads(done.stdout)["rmse"].values()) < 100
    done = sidestep(*named, "--out", "again.csv", cwd=tmp_path)
    assert "Read as: " in done.stdout
    assert "no repairs" in done.stdout
    before = (tmp_path / "c.csv").read_text()
    for options, says in (
        (("--out", "c.csv"), "--out"),
        (("--out", "c.txt"), ".csv"),
        (("--timezone", "Helsinki"), "Europe/Helsinki"),
        (("--columns", "ignore=Nobody"), "Nobody"),
        (("--columns", "when=When"), "--columns"),
        (("--date-format", "dd/mm"), "day-first"),
    ):
        assert says in one_sentence(sidestep(*named, *options, cwd=tmp_path))
    for option in (("--timezone", "Europe/Helsinki"), ("--decimal", ","), ("--date-format", "day-first")):
        assert f"{option[0]} is about a file" in one_sentence(sidestep("counts", *option, cwd=tmp_path))
    assert (tmp_path / "c.csv").read_text() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.csv", "c.csv", "clean"]


def test_new_scenarios_begin_with_own_files(sidestep, tmp_path):
    for options, says in (
        (("--streets", "none.npz"), "none.npz"),
        (("--counts", "none.csv"), "none.csv"),
        (("--timezone", "Helsinki"), "Europe/Helsinki"),
    ):
        assert says in one_sentence(sidestep("new", "town", *options, cwd=tmp_path))
    assert list(tmp_path.iterdir()) == []
    done = sidestep("new", "town", "--timezone", "Europe/Tallinn", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {"scenario": "town/scenario.toml", "sensors": 16, "at_their_places": 0}
    assert 'timezone = "Europe/Tallinn"' in (tmp_path / "town" / "scenario.toml").read_text()


def test_damaged_models_are_refused(sidestep, model, tmp_path):
    whole = (model / "model.eqx").read_bytes()
    line, numbers = whole.split(b"\n", 1)
    other = json.loads(line) | {"format": 99}
    cases = {
        "cut short": whole[: len(whole) // 2],
        "is not a Sidestep model": b"\x00\x01\x02",
        "has format 99": json.dumps(other).encode() + b"\n" + numbers,
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


def test_runs_are_listed_shown_and_compared(sidestep, model, local_model, tmp_path):
    shutil.copytree(model, tmp_path / "runs" / "grid")
    shutil.copytree(local_model[0], tmp_path / "runs" / "local")
    found = json.loads(sidestep("runs", tmp_path / "runs", "--json").stdout)
    assert [(Path(row["folder"]).name, row["state"], row["rounds"]) for row in found] == [
        ("grid", "finished", 40), ("local", "finished", 1),
    ]  # fmt: skip
    listed = sidestep("runs", tmp_path / "runs")
    assert re.search(
        r"\bgrid +finished +40/40 +\d+\.\d +\d\.\d\d % +paper-congested, map 0, seed 0 +position", listed.stdout
    )
    assert re.search(r"\blocal +finished +1/1 ", listed.stdout)
    # One of them
    grid, picture = tmp_path / "runs" / "grid", tmp_path / "new" / "curve.png"
    shown = sidestep("runs", "show", grid)
    assert shown.returncode == 0, shown.stderr
    assert "finished, 40 of 40 rounds" in shown.stdout
    assert "round 40\n" in shown.stdout
    assert f"Learning curve: {grid / 'learning-curve.png'}" in shown.stdout
    told = json.loads(sidestep("runs", "show", grid, "--out", picture, "--json").stdout)
    assert (len(told["minutes"]), len(told["metrics"]), told["picture"]) == (40, 40, str(picture))
    assert told["best_minutes"] == pytest.approx(min(told["minutes"]))
    assert told["metrics"][-1]["gap"] >= -1e-6
    assert picture.read_bytes().startswith(b"\x89PNG")
    # Both
    both = ("runs", "compare", grid, tmp_path / "runs" / "local")
    found = json.loads(sidestep(*both, "--json").stdout)
    assert found["settings"]["level"] == ["position", "local"]
    assert "seed" not in found["settings"]
    assert [len(run["minutes"]) for run in found["runs"]] == [40, 1]
    table = sidestep(*both).stdout
    assert re.search(r"\blevel +position +local\b", table)
    assert f"* {grid}" in table
    assert re.search(r"\n +40 +\d+\.\d +\d\.\d\d % *\n", table)
    assert "All settings are the same." in sidestep("runs", "compare", grid, grid).stdout
    # Neither
    assert "nowhere" in one_sentence(sidestep("runs", "nowhere"))
    assert "no training" in one_sentence(sidestep("runs", "show", tmp_path))
    assert "--out" in one_sentence(sidestep("runs", "show", grid, "--out", tmp_path / "curve.svg"))
    assert "starts one" in sidestep("runs", tmp_path / "new").stdout
