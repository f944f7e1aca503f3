"""Compiled programs: what is compiled, what is read, and what is never trusted."""

import os
import secrets
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Key

from sidestep import kept_programs, programs
from sidestep.programs import Kept, Program, program


class Pair(eqx.Module):
    one: Float[Array, "*n"]
    other: Key[Array, ""]
    name: str = eqx.field(static=True)


class Tagged(eqx.Module):
    x: Float[Array, "*n"]
    structure: Any = eqx.field(static=True)


def scaled(by: float, pair: Pair, more: Float[Array, "*n"]) -> Pair:
    return Pair(by * pair.one + more, jax.random.fold_in(pair.other, 1), pair.name)


def apply(rule, x):
    return rule(x)


def multiplied(name, x):
    return float(Path(name).read_text()) * x


def multiplied_by_two(x):
    return 2 * x


def squared(x):
    return x @ x


def tagged(x):
    return Tagged(x, jax.tree.structure(pair()))  # of a class: after a file, another


@dataclass(frozen=True)
class Negative:
    """Its text tells it apart, but not its code."""

    def __call__(self, x):
        return -x


def called(way, x):
    return way(x)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    kept = tmp_path / "programs"
    monkeypatch.setenv(kept_programs.FOLDER, str(kept))
    monkeypatch.setattr(programs, "counts", type(programs.counts)())
    token = secrets.token_hex()  # or JAX's own cache would know the programs of an earlier run
    monkeypatch.setattr(kept_programs, "_surroundings", lambda: token)
    monkeypatch.setattr(programs, "_KNOWN", programs._KNOWN | {__name__.partition(".")[0]})
    kept_programs.cache_folder.cache_clear()
    yield kept
    kept_programs.cache_folder.cache_clear()


def pair(n: int = 3, name: str = "a") -> Pair:
    return Pair(jnp.arange(n, dtype=float), jax.random.key(0), name)


def count(what: str) -> int:
    return programs.counts[what, "scaled"]


def check(made: Pair) -> None:
    assert made.one.tolist() == [1.0, 3.0, 5.0]
    assert made.name == "a"
    assert (
        jax.random.key_data(made.other).tolist()
        == jax.random.key_data(jax.random.fold_in(jax.random.key(0), 1)).tolist()
    )


@pytest.mark.usefixtures("folder")
def test_a_program_is_compiled_once_and_read_ever_after():
    first = program("by", quick=lambda **_: True)(scaled)
    for _ in range(2):
        check(first(2.0, pair(), jnp.ones(3)))
    assert (count("compiled"), count("loaded")) == (1, 0)
    again = program("by", quick=lambda **_: True)(scaled)
    assert again.shapes(2.0, pair(), jnp.ones(3)).one.shape == (3,)
    assert count("loaded") == 0  # shapes are told without the program
    check(again(2.0, pair(), jnp.ones(3)))
    assert (count("compiled"), count("loaded")) == (1, 1)


@pytest.mark.usefixtures("folder")
def test_what_has_been_lowered_is_not_traced_again_and_what_is_kept_not_at_all():
    for times in (1, 0):
        traced: list[int] = []

        def scaled_and_counted(by: float, x: Float[Array, "*n"]) -> Float[Array, "*n"]:
            traced.append(1)  # noqa: B023 - of this turn
            return by * x

        scaled_and_counted.__qualname__ = "scaled_and_counted"  # a local function would not be kept
        made = program("by")(scaled_and_counted)
        made.lower(2.0, jax.ShapeDtypeStruct((3,), jnp.float32))
        assert (len(traced), count("compiled")) == (times, 0)
        assert made(2.0, jnp.ones(3)).tolist() == [2.0, 2.0, 2.0]
        made.lower(2.0, jnp.ones(3))
        assert len(traced) == times


def test_static_arguments_shapes_trees_and_options_make_other_programs(folder):
    one = program("by")(scaled)
    one(2.0, pair(), jnp.ones(3))
    for arguments in ((3.0, pair(), jnp.ones(3)), (2.0, pair(4), jnp.ones(4)), (2.0, pair(name="b"), jnp.ones(3))):
        one(*arguments)
    program("by", quick=lambda **_: True)(scaled)(2.0, pair(), jnp.ones(3))
    assert (count("compiled"), count("loaded")) == (5, 0)
    assert len(list(folder.iterdir())) == 5


@pytest.mark.usefixtures("folder")
def test_plain_numbers_and_numpy_arrays_are_arguments():
    made = program()(lambda x, y: x + y)
    assert made(np.float32(1.5), np.arange(2, dtype=np.float32)).tolist() == [1.5, 2.5]
    assert made(1.5, jnp.arange(2.0)).tolist() == [1.5, 2.5]


@pytest.mark.usefixtures("folder")
def test_it_is_a_part_of_what_is_traced():
    made = program("by")(scaled)
    check(jax.jit(lambda here, more: made(2.0, here, more))(pair(), jnp.ones(3)))
    assert not programs.counts
    with jax.disable_jit():
        check(made(2.0, pair(), jnp.ones(3)))
    assert not programs.counts


@pytest.mark.usefixtures("folder")
def test_what_is_donated_is_used_up():
    for _ in range(2):  # compiled, then read
        made = program("by", donate=("more",))(scaled)
        here, more = pair(), jnp.ones(3)
        check(made(2.0, here, more))
        assert more.is_deleted()
        assert not here.one.is_deleted()
    assert (count("compiled"), count("loaded")) == (1, 1)


def test_what_differs_from_process_to_process_is_not_kept(folder):
    for rule in (jnp.negative, lambda x: -x):
        assert program("rule")(apply)(rule, jnp.ones(2)).tolist() == [-1, -1]
    assert not folder.exists()


def test_what_others_write_is_not_kept(folder):
    assert program()(lambda x: -x)(jnp.ones(2)).tolist() == [-1, -1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(programs, "_KNOWN", programs._KNOWN - {__name__.partition(".")[0]})
        check(program("by")(scaled)(2.0, pair(), jnp.ones(3)))
        assert program("way")(called)(Negative(), jnp.ones(2)).tolist() == [-1, -1]
    assert not folder.exists()


@pytest.mark.usefixtures("folder")
def test_files_that_are_read_count(tmp_path):
    file = tmp_path / "number"
    file.write_text("2")
    made = program("name", files=lambda name: (name,))(multiplied)
    assert made(str(file), jnp.float32(3)) == 6
    file.write_text("10")
    assert made(str(file), jnp.float32(3)) == 30


@pytest.mark.parametrize("damage", [b"", b"nothing", None])
def test_a_damaged_file_is_compiled_anew(folder, damage):
    program("by")(scaled)(2.0, pair(), jnp.ones(3))
    (file,) = folder.iterdir()
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2] if damage is None else damage)
    check(program("by")(scaled)(2.0, pair(), jnp.ones(3)))
    assert count("compiled") == 2
    check(program("by")(scaled)(2.0, pair(), jnp.ones(3)))
    assert count("loaded") == 1


def test_the_folder_is_for_its_owner_alone(folder):
    program("by")(scaled)(2.0, pair(), jnp.ones(3))
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o775)
    kept_programs.cache_folder.cache_clear()
    with pytest.warns(UserWarning, match=str(folder)):
        check(program("by")(scaled)(2.0, pair(), jnp.ones(3)))
    assert (count("compiled"), count("loaded")) == (2, 0)


def test_a_link_to_another_folder_is_not_followed(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.warns(UserWarning, match=str(folder)):
        program("by")(scaled)(2.0, pair(), jnp.ones(3))
    assert not list((tmp_path / "elsewhere").iterdir())


def test_the_folder_does_not_grow_for_ever(folder, monkeypatch):
    made = program("by")(scaled)
    for number in range(4):
        made(float(number), pair(), jnp.ones(3))
    size = max(each.stat().st_size for each in folder.iterdir())
    monkeypatch.setattr(kept_programs, "MOST_BYTES", 2.5 * size)
    made(9.0, pair(), jnp.ones(3))
    assert len(list(folder.iterdir())) == 2
    program("by")(scaled)(9.0, pair(), jnp.ones(3))
    assert count("loaded") == 1  # the latest is there


def test_training_from_python_compiles_two_programs_and_the_next_process_none(tmp_path):
    said = """
import jax, sidestep
from sidestep.programs import counts
compiled = []
def listen(name, *_, **__):
    if "backend_compile" in name:
        compiled.append(name)
jax.monitoring.register_event_duration_secs_listener(listen)
small = sidestep.preset("default").changed(rounds=3, round_steps=64, walkers=8, batch=16, capacity=64, futures=4)
run = sidestep.train(sidestep.scenario("paper-congested", side=3, crowded_nodes=1), small)
print(len(compiled), dict(sorted(counts.items())), run.model.q_network.value.weight.tolist())
"""
    told = {name: value for name, value in os.environ.items() if not name.startswith("JAX_COMP")}
    home = {"SIDESTEP_CACHE": str(tmp_path / "programs"), "XDG_CACHE_HOME": str(tmp_path)}
    first, second = (
        subprocess.run([sys.executable, "-c", said], env=told | home, text=True, capture_output=True, check=True)
        for _ in range(2)
    )
    done, learned = first.stdout.split("}")
    read, again = second.stdout.split("}")
    assert done == "2 {('compiled', 'prepare'): 1, ('compiled', 'train_round'): 1"
    assert read == "0 {('loaded', 'prepare'): 1, ('loaded', 'train_round'): 1"
    assert learned == again


def test_what_is_not_the_same_once_it_is_read_is_not_kept(folder):
    assert program()(tagged)(jnp.ones(2)).structure == jax.tree.structure(pair())
    assert not list(folder.iterdir())


@pytest.mark.usefixtures("folder")
def test_options_that_the_compiler_does_not_know_are_left_out(monkeypatch):
    monkeypatch.setattr(programs, "QUICK", {"xla_no_such_option": True, "xla_backend_optimization_level": 1})
    check(program("by", quick=lambda **_: True)(scaled)(2.0, pair(), jnp.ones(3)))
    monkeypatch.setattr(programs, "QUICK", {"xla_no_such_option": True})
    check(program("by", quick=lambda **_: True)(scaled)(2.0, pair(), jnp.ones(3)))
    assert count("compiled") == 2


def test_other_files_in_the_folder_are_not_deleted(folder, monkeypatch):
    made = program("by")(scaled)
    made(1.0, pair(), jnp.ones(3))
    (folder / "thesis.tex").write_text("mine")
    monkeypatch.setattr(kept_programs, "MOST_BYTES", 0)
    made(2.0, pair(), jnp.ones(3))
    assert [each.name for each in folder.iterdir()] == ["thesis.tex"]


@pytest.mark.usefixtures("folder")
def test_settings_of_jax_make_other_programs():
    made = program()(multiplied_by_two)
    assert made(jnp.float32(3)).dtype == jnp.float32
    with jax.default_matmul_precision("highest"):
        made(jnp.float32(3))
    assert programs.counts["compiled", "multiplied_by_two"] == 2


def test_matrices_are_multiplied_in_full_unless_jax_is_told():
    square = jnp.eye(2)
    traced = [str(jax.make_jaxpr(program()(squared))(square))]
    with jax.default_matmul_precision("tensorfloat32"):
        traced.append(str(jax.make_jaxpr(program()(squared))(square)))
    assert ["HIGHEST" in each for each in traced] == [True, False]


class Counted(Program):
    """A program that counts its calls."""

    calls = 0

    def __call__(self, *args, **kwargs):
        self.calls += 1
        return super().__call__(*args, **kwargs)


def test_results_are_kept_as_long_as_there_is_room():
    source = Counted(lambda numbers, times: numbers * times, ("times",))
    keeping, one, two = Kept(source, 2 * 4 * 4), np.ones(4, np.float32), np.full(4, 2, np.float32)

    def kept(numbers, times):
        return keeping.given(numbers, times=times)()

    first = kept(one, 3)
    assert kept(one.copy(), 3) is first  # equal arguments, made anew
    assert source.calls == 1
    whole = one.view(np.int32)  # of the same bytes
    for other in ((two, 3), (one, 2), (one.reshape(2, 2), 3), (whole, 3)):
        kept(*other)
    assert source.calls == 5
    assert keeping.bytes == 2 * 4 * 4
    kept(one, 3)  # was asked for longest ago, and is gone
    assert source.calls == 6
    assert kept(whole, 3).tolist() == (3 * whole).tolist()
    assert source.calls == 6
    assert Kept(source, 15).given(one, times=3)().tolist() == [3, 3, 3, 3]  # more than there is room for
    programs.clear_caches()
    assert keeping.bytes == 0
    kept(whole, 3)
    assert source.calls == 8


def test_large_arguments_are_read_once_for_many_calls(monkeypatch):
    source, read = Counted(lambda large, small: large[small]), []
    contents = programs._contents

    def noted(values):
        read.extend(leaf.shape for leaf in values)
        return contents(values)

    monkeypatch.setattr(programs, "_contents", noted)
    keeping, large = Kept(source, 1000), np.arange(9, dtype=np.float32)
    for _ in range(2):
        at = keeping.given(large)
        assert [float(at(np.int32(number))) for number in (3, 5, 3)] == [3.0, 5.0, 3.0]
    assert source.calls == 2
    assert read.count((9,)) == 2
    assert float(keeping.given(large + 1)(np.int32(3))) == 4.0


def test_of_small_results_few_are_kept(monkeypatch):
    monkeypatch.setattr(programs, "_MOST_RESULTS", 2)
    source = Counted(lambda numbers: 2 * numbers)
    kept, arguments = Kept(source, 1000), [np.full(4, number, np.float32) for number in range(3)]
    for each in (*arguments, arguments[1], arguments[2], arguments[0]):
        kept.given()(each)
    assert (source.calls, kept.bytes) == (4, 2 * 4 * 4)


def test_a_result_without_room_drives_out_no_other():
    source = Counted(lambda numbers: 2 * numbers)
    kept, small, large = Kept(source, 16), np.ones(4, np.float32), np.ones(5, np.float32)
    for each in (small, large, small):
        kept.given()(each)
    assert (source.calls, kept.bytes) == (2, 16)
