"""Compiled programs are kept from process to process, in JAX's own cache: compiling takes longer than most answers."""

import os
from pathlib import Path

SMALLEST: dict[str, object] = {
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}
"""Settings of JAX by which it keeps small programs, too."""
OWNER_ONLY = 0o700


def cache_folder() -> Path:
    """The folder in which compiled programs are kept where nobody names another one."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "sidestep" / "jax"


def keep_compiled() -> None:
    """Let JAX keep what this process compiles from now on, and find what others of this user have compiled.

    Nothing changes where JAX was told where to keep programs, or to keep none (``JAX_COMPILATION_CACHE_DIR``,
    ``jax_compilation_cache_dir``, ``jax_enable_compilation_cache``), nor where this user has no folder of their own
    that nobody else can write to: what is kept there is run.
    """
    import jax

    told, on = (jax.config.values[f"jax_{name}"] for name in ("compilation_cache_dir", "enable_compilation_cache"))
    if told is not None or not on:
        return
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(OWNER_ONLY)  # only its owner may
    except (OSError, RuntimeError):  # no home, or one that is not to be written to
        return
    if os.access(folder, os.W_OK):
        configure({"jax_compilation_cache_dir": str(folder), **SMALLEST})


def configure(settings: dict[str, object]) -> None:
    """Change settings of JAX, by name."""
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]
