"""Compiled programs: each is traced and compiled once a machine, and read from a folder of the user's ever after.

JAX's own persistent cache is asked only after a function has been traced and lowered, which takes longer than to read
what it was compiled to. Here the name of a file says all that a program depends on: Sidestep's source, the libraries,
the processor, flags, static arguments, and the shapes of the others.
"""

import inspect
import re
import secrets
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import partial, update_wrapper
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import jax
import numpy as np
from numpy.typing import ArrayLike

from sidestep import kept_programs
from sidestep.files import stamps

P = ParamSpec("P")
Made = TypeVar("Made")

QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}
"""Options of the compiler on a CPU for programs that do not run for long."""
_IN_MEMORY = 128  # programs for each function
_UNSURE = re.compile(r"(?<!key)<|\.\.\.")  # in texts of what has no literal, as functions, or that leave something out

counts: Counter[tuple[str, str]] = Counter()
"""How often a function was "compiled" and "loaded" in this process, by its name."""


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
    ) -> None:
        update_wrapper(self, function)
        self._function, self._static, self._donate = function, static, donate
        self._name = function.__qualname__
        self._quick, self._files = quick, files
        self._signature = inspect.signature(function)
        self._jitted = jax.jit(function, static_argnames=static, donate_argnames=donate)
        self._variants: OrderedDict[Any, _Variant] = OrderedDict()
        self._lock = threading.Lock()

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Made:
        static, tree, leaves = self._sorted(*args, **kwargs)
        within = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
        if within or jax.config.jax_disable_jit:  # type: ignore[attr-defined]
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

    def prepare(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Load or compile what a call needs; arguments may be shapes and types."""
        self._variant(*self._sorted(*args, **kwargs)).executable()

    def clear(self) -> None:
        """Forget what is in memory."""
        self._variants.clear()

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
        read = stamps(self._files(**static))
        key = (*static.values(), tree, types, read, jax.config.jax_enable_x64)  # type: ignore[attr-defined]
        with self._lock:
            found = self._variants.get(key)
            if found is None:
                if len(self._variants) == _IN_MEMORY:
                    self._variants.popitem(last=False)
                options = QUICK if self._quick(**static) and jax.default_backend() == "cpu" else {}
                told = repr((static, tree, types, self._donate, read, options))
                donated = _places(tree, self._donate)
                function = partial(self._function, **static)
                found = _Variant(self._name, function, tree, types, donated, options, self._file(told))
                self._variants[key] = found
            self._variants.move_to_end(key)
        return found

    def _file(self, told: str) -> Path | None:
        """Where a program is kept that depends on what is ``told``; None where it cannot be."""
        # Of other packages the source is not known.
        if not self.__module__.startswith(f"{__package__}.") or _UNSURE.search(told):
            return None
        return kept_programs.file_of(f"{self.__module__} {self._name} {told}")


def on_device(values: ArrayLike, dtype: type[np.generic] = np.float32) -> jax.Array:
    """Make a JAX array of plain numbers; ``jnp.asarray`` compiles a program for each shape that it meets."""
    return jax.device_put(np.asarray(values, dtype))


def program(
    *static: str,
    donate: tuple[str, ...] = (),
    quick: Callable[..., bool] = lambda **_: False,
    files: Callable[..., tuple[str, ...]] = lambda **_: (),
) -> Callable[[Callable[P, Made]], Program[P, Made]]:
    """Make a :class:`Program` of a function.

    Parameters
    ----------
    *static
        Names of arguments that are no arrays. They must be hashable, and their ``repr`` must tell them apart; where it
        is no literal, as that of a function, the program is kept in memory only.
    donate
        Names of arguments that are used up.
    quick
        Says of the static arguments, which are given by name, whether the program takes less time than its compilation.
        Then it is compiled in two thirds of that time, on a CPU; long loops of small steps it may make slower.
    files
        Picks the names of files that the function reads out of the static arguments, as well by name.

    Returns
    -------
    Callable
        A decorator of the function.
    """
    return lambda function: Program(function, static, donate, quick, files)


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
    ) -> None:
        self._name, self._function, self._tree, self._types, self._donated = name, function, tree, types, donated
        self._options, self._file = options, file
        self._lock = threading.RLock()
        self._traced: Any = None
        self._executable: Callable[..., list[Any]] | None = None
        self._kept: bytes | None = None
        self._made: Any = None
        self._made_tree: Any = None

    def run(self, leaves: list[Any]) -> Any:
        """Call it."""
        executable = self._executable or self.executable()
        return jax.tree.unflatten(self._made_tree, executable(*leaves))

    def made(self) -> Any:
        """Shapes and types of what it makes."""
        with self._lock:
            if self._made_tree is None and not self._read():
                self._trace()
        return self._made

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
            loaded = serialize_executable.deserialize_and_load(self._kept, *trees)
        except Exception:  # noqa: BLE001 - whatever a damaged file may bring about: it is compiled anew
            return None
        self._kept = None  # a megabyte
        counts["loaded", self._name] += 1
        return loaded

    def _trace(self) -> None:
        # Of flat leaves: the trees of arguments cannot be read back from a file.
        def flat(*leaves: Any) -> list[Any]:
            flattened, self._made_tree = jax.tree.flatten(self._function(**jax.tree.unflatten(self._tree, leaves)))
            return flattened

        flat.__name__ = self._name
        if self._file is not None and jax.config.values["jax_compilation_cache_dir"]:
            # JAX's own cache must not know it: what was read from there cannot be written once more.
            flat.__name__ += f"_{secrets.token_hex(4)}"
        shapes = [_shape(*each) for each in self._types]
        self._traced = jax.jit(flat, donate_argnums=self._donated).trace(*shapes)
        info = [_shape(each.shape, each.dtype) for each in self._traced.out_info]
        self._made = jax.tree.unflatten(self._made_tree, info)

    def _compile(self) -> Callable[..., list[Any]]:
        if self._traced is None:
            self._trace()
        counts["compiled", self._name] += 1
        compiled = _compiled(self._traced.lower(), self._options)
        self._traced = None
        if self._file is not None:
            kept_programs.write(self._file, compiled, self._made)
        return compiled


def _compiled(lowered: Any, options: dict[str, Any]) -> Callable[..., list[Any]]:
    """Compile, without those options that this version of XLA does not know."""
    for known in (options, *({name: value} for name, value in options.items())):
        with suppress(jax.errors.JaxRuntimeError):
            compiled: Callable[..., list[Any]] = lowered.compile(compiler_options=known)
            return compiled
    return lowered.compile()


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
