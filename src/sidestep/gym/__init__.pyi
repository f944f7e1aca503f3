from .env import WalkEnv as WalkEnv
from .options import EnvError as EnvError
from .options import EnvOptions as EnvOptions
from .options import VectorOptions as VectorOptions
from .task import Task as Task
from .task import make_task as make_task
from .vector import WalkVectorEnv as WalkVectorEnv

IDS: dict[str, str]
