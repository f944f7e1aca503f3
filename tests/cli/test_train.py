"""What `train` prints."""

from typing import get_args

from sidestep.agent.config import TrainConfig
from sidestep.cli.train import KEPT


def test_every_way_to_keep_a_network_has_its_words() -> None:
    assert {*KEPT} == {*get_args(TrainConfig.model_fields["keep"].annotation)}
