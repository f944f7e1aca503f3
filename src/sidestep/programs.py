"""Compiled programs: each is traced and compiled once a machine, and read from a folder of the user's ever after.

JAX's own persistent cache is asked only after a function has been traced and lowered, which takes longer than to read
what it was compiled to. Here the name of a file says all that a program depends on: Sidestep's source, the libraries,
the processor, flags, static arguments, and the shapes of the others.
"""

import hashlib
import inspect
import math
import os
import re
import secrets
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable
from functools import partial, update_wrapper, wraps
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar
from weakref import WeakSet

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from numpy.typing import ArrayLike

from sidestep import kept_programs
from sidestep.files import stamps

P = ParamSpec("P")
Made = TypeVar("Made")
Tree = TypeVar("Tree")

QUICK = {
    "xla_cpu_use_fusion_emitters": False,
    "xla_backend_optimization_level": 1,
    "xla_cpu_parallel_codegen_split_count": 4,  # of 32 parts each repeats some of the others' work
}
"""Options of the compiler on a CPU for programs that do not run for long."""
REPEATABLE = {"xla_gpu_deterministic_ops": True}
"""Options on a GPU, where sums otherwise add up in another order every time; flags of these names come first."""
_IN_MEMORY = 128  # programs for each function
_MOST_RESULTS = 4096  # of a program: beside small arrays what stands around them takes most of the memory
_KNOWN = {"builtins", "collections", "sidestep", "jax", "jaxlib", "numpy", "equinox", "optax"}
"""Packages whose code does not change, or is part of the names of files."""
_WALKERS = "walkers"
"""The axis of devices, as JAX calls it."""
_UNSURE = re.compile(r"(?<!key)<|\.\.\.")  # in texts of what has no literal, or that leave something out
_SETTINGS = (
    "jax_enable_x64", "jax_default_matmul_precision", "jax_default_prng_impl", "jax_threefry_partitionable",
    "jax_numpy_dtype_promotion", "jax_numpy_rank_promotion", "jax_default_device",
)  # fmt: skip
"""Settings of JAX that change what is traced, and may hold for a part of a program."""

counts: Counter[tuple[str, str]] = Counter()
"""How often a function was "compiled" and "loaded" in this process, by its name."""


_programs: "WeakSet[Program[Any, Any]]" = WeakSet()
_keeping: "WeakSet[Kept[Any]]" = WeakSet()


class Program(Generic[P, Made]):
    """A function that is compiled for each set of static arguments and shapes of the others.

    It is called like the function. Within another function that JAX traces, it becomes a part of that.
    """

    def __init__(
        self,
        function: Callable[P, Made],
        static: tuple[str, ...] = (),
        donate: tuple[str, ...] = (),
        quick: Callable[..., bool] = lambda **_: False,
        files: Callable[..., tuple[str, ...]] = lambda **_: (),
        *,
        spread: bool = False,
    ) -> None:
        update_wrapper(self, function)
        function = _in_full(function)
        self._function, self._static, self._donate = function, static, donate
        self._name = function.__qualname__
        self._quick, self._files, self._spread = quick, files, spread
        self._signature = inspect.signature(function)
        self._jitted = jax.jit(function, static_argnames=static, donate_argnames=donate)
        self._variants: OrderedDict[Any, _Variant] = OrderedDict()
        self._lock = threading.Lock()
        _programs.add(self)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Made:
        static, tree, leaves = self._sorted(*args, **kwargs)
        if jax.config.jax_disable_jit or _left_to_jax(leaves, self._devices()):  # type: ignore[attr-defined]
            return self._jitted(*args, **kwargs)
        return self._variant(static, tree, leaves).run(leaves)

    def shapes(self, *args: P.args, **kwargs: P.kwargs) -> Made:
        """Shapes and types of what the function makes, without a call; arguments may be shapes and types as well.

        Returns
        -------
        Made
            With :class:`jax.ShapeDtypeStruct` in the place of arrays.
        """
        return self._variant(*self._sorted(*args, **kwargs)).made()

    def lower(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Do that part of :meth:`prepare` which is Python, and for which threads wait for each other."""
        self._variant(*self._sorted(*args, **kwargs)).lower()

    def prepare(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Load or compile what a call needs; arguments may be shapes and types."""
        self._variant(*self._sorted(*args, **kwargs)).executable()

    def _devices(self) -> list[jax.Device]:
        """Where it runs."""
        return _devices() if self._spread else [_default_device()]

    def _sorted(self, *args: P.args, **kwargs: P.kwargs) -> tuple[dict[str, Any], Any, list[Any]]:
        """Static arguments by name, and the tree and leaves of the others."""
        bound = self._signature.bind(*args, **kwargs)
        bound.apply_defaults()
        given = dict(bound.arguments)
        static = {name: given.pop(name) for name in self._static}
        leaves, tree = jax.tree.flatten(given)
        return static, tree, leaves

    def _variant(self, static: dict[str, Any], tree: Any, leaves: list[Any]) -> "_Variant":
        types = tuple(map(_type_of, leaves))
        names = self._files(**static)
        read = tuple(zip((str(Path(name).resolve()) for name in names), stamps(names), strict=True))
        settings = tuple(str(getattr(jax.config, name)) for name in _SETTINGS)
        key = (*static.values(), tree, types, read, settings)
        with self._lock:
            found = self._variants.get(key)
            if found is None:
                if len(self._variants) == _IN_MEMORY:
                    self._variants.popitem(last=False)
                options = _options(quick=self._quick(**static))
                devices = self._devices()
                told = repr((static, tree, types, self._donate, read, settings, options, len(devices)))
                # Of other packages the source is not known.
                known = _is_known((self._function, static)) and _are_known(tree) and not _UNSURE.search(told)
                file = kept_programs.file_of(f"{self.__module__} {self._name} {told}") if known else None
                donated = _places(tree, self._donate)
                function = partial(self._function, **static)
                found = _Variant(self._name, function, tree, types, donated, options, file, devices)
                self._variants[key] = found
            self._variants.move_to_end(key)
        return found


class Kept(Generic[Made]):
    """A program whose latest results are kept for calls with equal arguments, which threads may share.

    Arguments are arrays, numbers, and trees of these. They are told apart by their contents, however often they are
    made.

    Parameters
    ----------
    program
        It must not use up arguments, since results are not copied.
    most_bytes
        Of all results that are kept; those that were asked for longest ago go first.
    """

    def __init__(self, program: Program[..., Made], most_bytes: int) -> None:
        self._program, self._most_bytes = program, most_bytes
        self._results: OrderedDict[Any, Made] = OrderedDict()
        self._lock = threading.Lock()
        self.bytes = 0
        """Of all results that are kept now."""
        _keeping.add(self)

    def given(self, *first: Any, **static: Hashable) -> Callable[..., Made]:
        """Give it the first arguments, which are read only once, and static ones, for calls that give the others."""
        known = (*sorted(static.items()), *_contents(first))
        return lambda *rest: self._kept((known, _contents(rest)), partial(self._program, *first, *rest, **static))

    def _kept(self, key: Any, make: Callable[[], Made]) -> Made:
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
                return self._results[key]
        made = make()
        with self._lock:
            # What there is no room for does not drive out what there is; another thread may have been faster.
            if key not in self._results and bytes_of(made) <= self._most_bytes:
                self._results[key] = made
                self.bytes += bytes_of(made)
                while self.bytes > self._most_bytes or len(self._results) > _MOST_RESULTS:
                    self.bytes -= bytes_of(self._results.popitem(last=False)[1])
        return made

    def clear(self) -> None:
        """Keep none any longer."""
        with self._lock:
            self._results.clear()
            self.bytes = 0


def _contents(values: Any) -> tuple[Any, ...]:
    """What values are, by which equal ones are known: their structure, types and bytes."""
    leaves, tree = jax.tree.flatten(values)
    contents = hashlib.blake2b()
    for leaf in leaves:
        contents.update(np.ascontiguousarray(leaf).data)
    return (tree, *map(_type_of, leaves), contents.digest())


def bytes_of(tree: Any) -> int:
    """Bytes of the arrays of a tree, or of those that shapes and types stand for."""
    return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(tree))


def clear_caches() -> None:
    """Forget all programs in memory and their results, as :func:`jax.clear_caches` does with what JAX compiled."""
    for each in _programs:
        each._variants.clear()  # noqa: SLF001 - of this module
    for kept in _keeping:
        kept.clear()


def on_device(values: ArrayLike, dtype: type[np.generic] = np.float32) -> jax.Array:
    """Make a JAX array of plain numbers; ``jnp.asarray`` compiles a program for each shape that it meets."""
    return jax.device_put(np.asarray(values, dtype))


def program(
    *static: str,
    donate: tuple[str, ...] = (),
    quick: Callable[..., bool] = lambda **_: False,
    files: Callable[..., tuple[str, ...]] = lambda **_: (),
    spread: bool = False,
) -> Callable[[Callable[P, Made]], Program[P, Made]]:
    """Make a :class:`Program` of a function.

    Parameters
    ----------
    *static
        Names of arguments that are no arrays. They must be hashable, and their ``repr`` must tell them apart. Programs
        of functions and classes of other packages are kept in memory only.
    donate
        Names of arguments that are used up.
    quick
        Says of the static arguments, which are given by name, whether the program takes less time than its compilation.
        Then it is compiled in two thirds of that time, on a CPU; long loops of small steps it may make slower.
    files
        Picks the names of files that the function reads out of the static arguments, as well by name.
    spread
        Run it on all devices at once. They divide what :func:`over_devices` says, and all of them do the rest, and have
        the arguments and the results. On one device nothing changes.

    Returns
    -------
    Callable
        A decorator of the function.
    """
    return lambda function: Program(function, static, donate, quick, files, spread=spread)


class _Variant:
    """A function compiled for some static arguments and shapes, by whichever thread needs it first."""

    def __init__(
        self,
        name: str,
        function: Callable[..., Any],
        tree: Any,
        types: tuple[tuple[tuple[int, ...], Any], ...],
        donated: tuple[int, ...],
        options: dict[str, Any],
        file: Path | None,
        devices: list[jax.Device],
    ) -> None:
        self._name, self._function, self._tree, self._types, self._donated = name, function, tree, types, donated
        self._options, self._file, self._devices = options, file, devices
        self._sharding = NamedSharding(_mesh(devices), _spec()) if len(devices) > 1 else None
        self._lock = threading.RLock()
        self._traced: Any = None
        self._lowered: Any = None
        self._executable: Callable[..., list[Any]] | None = None
        self._kept: bytes | None = None
        self._made: Any = None
        self._made_tree: Any = None

    def run(self, leaves: list[Any]) -> Any:
        """Call it."""
        executable = self._executable or self.executable()
        if self._sharding is not None:
            leaves = jax.device_put(leaves, self._sharding)
        return jax.tree.unflatten(self._made_tree, executable(*leaves))

    def made(self) -> Any:
        """Shapes and types of what it makes."""
        with self._lock:
            if self._made_tree is None and not self._read():
                self._trace()
        return self._made

    def lower(self) -> None:
        """Trace and lower it, unless it is kept."""
        with self._lock:
            if self._executable is None and self._lowered is None and not self._read():
                if self._traced is None:
                    self._trace()
                self._lowered = self._traced.lower()

    def executable(self) -> Callable[..., list[Any]]:
        """Load or compile it."""
        with self._lock:
            if self._executable is None:
                self._executable = self._load() or self._compile()
            return self._executable

    def _read(self) -> bool:
        """Read it, and say whether it was there."""
        if self._file is not None and self._kept is None and (kept := kept_programs.read(self._file)) is not None:
            self._kept, self._made = kept
            self._made_tree = jax.tree.structure(self._made)
        return self._kept is not None

    def _load(self) -> Callable[..., list[Any]] | None:
        """Make it ready to be called, if it was kept."""
        from jax.experimental import serialize_executable

        if self._traced is not None or not self._read():
            return None
        trees = (
            jax.tree.structure(((0,) * len(self._types), {})),
            jax.tree.structure([0] * self._made_tree.num_leaves),
        )
        try:
            loaded = serialize_executable.deserialize_and_load(self._kept, *trees, execution_devices=self._devices)
        except Exception:  # noqa: BLE001 - whatever a damaged file may bring about: it is compiled anew
            return None
        self._kept = None  # a megabyte
        counts["loaded", self._name] += 1
        return loaded

    def _trace(self, suffix: str = "") -> None:
        # Of flat leaves: the trees of arguments cannot be read back from a file.
        def flat(*leaves: Any) -> list[Any]:
            flattened, self._made_tree = jax.tree.flatten(self._function(**jax.tree.unflatten(self._tree, leaves)))
            return flattened

        # JAX's own cache must not take it for an older one of the same operations.
        flat.__name__ = self._name + (suffix or ("" if self._file is None else f"_{self._file.name[:8]}"))
        shapes = [_shape(*each) for each in self._types]
        placed: dict[str, Any] = {}
        if self._sharding is not None:
            placed = {"in_shardings": self._sharding, "out_shardings": self._sharding}
        self._traced = jax.jit(flat, donate_argnums=self._donated, **placed).trace(*shapes)
        info = [_shape(each.shape, each.dtype) for each in self._traced.out_info]
        self._made = jax.tree.unflatten(self._made_tree, info)

    def _compile(self) -> Callable[..., list[Any]]:
        if self._traced is None:
            self._trace()
        counts["compiled", self._name] += 1
        before = kept_programs.hits()
        compiled = _compiled(self._lowered or self._traced.lower(), self._options)
        if self._file is not None and kept_programs.hits() != before:
            # What JAX read from its own cache cannot be written once more: it is compiled under another name.
            self._trace(f"_{secrets.token_hex(4)}")
            compiled = _compiled(self._traced.lower(), self._options)
        self._traced = self._lowered = None
        if self._file is not None:
            kept_programs.write(self._file, compiled, self._made)
        return compiled


def _options(*, quick: bool) -> dict[str, Any]:
    """Those of the compiler, by where programs run."""
    if jax.default_backend() == "cpu":
        return QUICK if quick else {}
    flags = os.environ.get("XLA_FLAGS", "")
    return {name: value for name, value in REPEATABLE.items() if name not in flags}


def _in_full(function: Callable[P, Made]) -> Callable[P, Made]:
    """Multiply matrices with all digits of their numbers, of which GPUs take three unless JAX has been told."""

    @wraps(function)
    def traced(*args: P.args, **kwargs: P.kwargs) -> Made:
        told = jax.config.jax_default_matmul_precision  # type: ignore[attr-defined]
        with jax.default_matmul_precision(told or "highest"):
            return function(*args, **kwargs)

    return traced


def _compiled(lowered: Any, options: dict[str, Any]) -> Callable[..., list[Any]]:
    """Compile, without those options that this version of XLA does not know."""
    while True:
        try:
            compiled: Callable[..., list[Any]] = lowered.compile(compiler_options=options)
        except jax.errors.JaxRuntimeError as error:
            known = {name: value for name, value in options.items() if name not in str(error)}
            if not options:
                raise
            options = {} if known == options else known
        else:
            return compiled


def _left_to_jax(leaves: list[Any], devices: list[jax.Device]) -> bool:
    """Whether an argument is being traced, or lies elsewhere than on the devices that a program is compiled for."""
    if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return True
    if jax.device_count() == 1:
        return False
    return any(isinstance(leaf, jax.Array) and not leaf.devices() <= {*devices} for leaf in leaves)


def _default_device() -> jax.Device:
    told = jax.config.jax_default_device  # type: ignore[attr-defined]
    return jax.devices(told)[0] if told is None or isinstance(told, str) else told


def _devices() -> list[jax.Device]:
    """All devices of this process, or the one that JAX has been told to use."""
    told = jax.config.jax_default_device  # type: ignore[attr-defined]
    return jax.local_devices() if told is None else [_default_device()]


def _mesh(devices: list[jax.Device], parts: int = 1) -> Mesh:
    """Devices in rows, each of which does a part; those in a row all do the same."""
    return Mesh(np.array(devices).reshape(parts, -1), (_WALKERS, "copies"))


def over_devices(
    function: Callable[..., Made], walkers: int, in_axes: tuple[int, ...], out_axes: int | tuple[int, ...] = 0
) -> Callable[..., Made]:
    """Divide walkers among devices, in a program that is spread over these: each takes the steps of its own.

    Parameters
    ----------
    function
        Of arrays of any number of walkers, who know nothing of each other.
    walkers
        How many there are. They become as many equal parts as the greatest number that divides both this number and
        that of devices.
    in_axes, out_axes
        The axis of walkers in each argument, and in each array that the function makes.

    Returns
    -------
    Callable
        The same function of all walkers.
    """
    devices = _devices()
    if (parts := math.gcd(walkers, len(devices))) == 1:
        return function
    into, out = (jax.tree.map(lambda axis: _spec(*[None] * axis, _WALKERS), axes) for axes in (in_axes, out_axes))
    # A check of what is the same on all devices would have to be told so in every loop.
    divided: Callable[..., Made] = jax.shard_map(
        function, mesh=_mesh(devices, parts), in_specs=into, out_specs=out, check_vma=False
    )
    return divided


def on_every_device(tree: Tree) -> Tree:
    """Gather what has been divided among devices: what follows is then computed as on one."""
    if len(devices := _devices()) == 1:
        return tree
    return jax.lax.with_sharding_constraint(tree, NamedSharding(_mesh(devices), _spec()))  # type: ignore[no-untyped-call]


def _spec(*axes: str | None) -> PartitionSpec:
    return PartitionSpec(*axes)  # type: ignore[no-untyped-call]


def _is_known(value: Any) -> bool:
    """Whether the text of a value says all of it, and its code is known: not that of functions of others, say."""
    if isinstance(value, dict):
        return all(map(_is_known, value.values()))
    if isinstance(value, (tuple, list, frozenset)):
        return all(map(_is_known, value))
    named = value if hasattr(value, "__qualname__") else type(value)
    return f"{named.__module__}".partition(".")[0] in _KNOWN and "<" not in named.__qualname__


def _are_known(tree: Any) -> bool:
    """The same of the nodes of a tree."""
    if (node := tree.node_data()) is None:
        return True
    kind, told = node
    return _is_known(kind) and _is_known(told) and all(map(_are_known, tree.children()))


def _type_of(leaf: Any) -> tuple[tuple[int, ...], Any]:
    """Shape and type; those of plain numbers are JAX's."""
    found = leaf if isinstance(leaf, (jax.Array, jax.ShapeDtypeStruct)) else jax.typeof(leaf)
    return found.shape, found.dtype


def _shape(shape: tuple[int, ...], dtype: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, dtype)  # type: ignore[no-untyped-call]


def _places(tree: Any, donate: tuple[str, ...]) -> tuple[int, ...]:
    """Numbers of the leaves of some of the arguments."""
    given = jax.tree.unflatten(tree, range(tree.num_leaves))
    return tuple(number for name in donate for number in jax.tree.leaves(given[name]))
