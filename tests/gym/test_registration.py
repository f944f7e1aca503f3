"""What importing does, and does not do."""

import subprocess
import sys

import gymnasium
import pytest

import sidestep.gym


def printed(code: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not done.stderr
    return done.stdout.split()


def test_sidestep_alone_does_not_load_gymnasium() -> None:
    assert printed("import sys, sidestep; print('gymnasium' in sys.modules, 'sidestep.gym' in sys.modules)") == [
        "False", "False",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "imports",
    ["import gymnasium, sidestep", "import sidestep, gymnasium, sidestep.gym", "import sidestep.gym, gymnasium"],
)
def test_environments_are_registered_and_nothing_heavy_is_loaded(imports: str) -> None:
    code = "import sys; print(*sorted(i for i in gymnasium.registry if i[0] == 's'), 'jax' in sys.modules)"
    assert printed(f"{imports}; {code}") == [*sorted(sidestep.gym.IDS), "False"]


def test_gymnasium_loads_sidestep_by_the_module_in_an_id() -> None:
    code = "import gymnasium; print(gymnasium.spec('sidestep.gym:sidestep/Rush-v0').kwargs['scenario'])"
    code = code.replace("gymnasium.spec(", "gymnasium.envs.registration._find_spec(")
    assert printed(code) == ["rush-16"]


def test_every_id_has_a_scenario_and_both_kinds_of_environments() -> None:
    for name, scenario in sidestep.gym.IDS.items():
        spec = gymnasium.spec(name)
        assert spec.kwargs == {"scenario": scenario}
        assert sidestep.scenario(scenario).name == scenario
        assert spec.entry_point
        assert spec.vector_entry_point


def test_environments_are_made_again_from_their_spec() -> None:
    made = gymnasium.make("sidestep/Rush-v0", scenario="paper-unblocked", futures=2, observation="node")
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(made.spec.to_json()))
    assert again.reset(seed=1)[0] == made.reset(seed=1)[0] == 0
    assert again.observation_space == made.observation_space == gymnasium.spaces.Discrete(36)
