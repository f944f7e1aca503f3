from .agent.checkpoint import load_model as load_model
from .agent.config import TrainConfig as TrainConfig
from .agent.presets import PRESETS as PRESETS
from .agent.presets import preset as preset
from .agent.runs import train as train
from .errors import SidestepError as SidestepError
from .evaluation.compare import compare as compare
from .network.formats import load_helsinki as load_helsinki
from .network.formats import load_town as load_town
from .network.graph import RoadNetwork as RoadNetwork
from .network.graph import road_network as road_network
from .network.osm import import_osm as import_osm
from .planners.base import routes as routes
from .planners.learned import Darp as Darp
from .planners.learned import trained_darp as trained_darp
from .planners.registry import choose_planners as choose_planners
from .planners.registry import find_planner as find_planner
from .planners.registry import register_planner as register_planner
from .routing.grid_plan import foresee as foresee
from .scenarios.builtin import scenario as scenario
from .scenarios.episodes import instances as instances
from .scenarios.futures import make_environment as make_environment
from .scenarios.maps import draw_map as draw_map
from .scenarios.maps import draw_training_map as draw_training_map
from .scenarios.model import Scenario as Scenario
from .scenarios.reader import load_scenario as load_scenario

__version__: str
