"""Compiled programs are kept from process to process, in JAX's own cache: compiling takes longer than most answers."""

from contextlib import suppress

from sidestep.files import OutputError, own_cache, private_folder

SMALLEST: dict[str, object] = {
    "persistent_cache_min_compile_time_secs": 0.0,
    "persistent_cache_min_entry_size_bytes": -1,
}
"""Settings of JAX by which it keeps small programs, too."""


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
    with suppress(OutputError):
        configure({"compilation_cache_dir": str(private_folder(own_cache("jax"))), **SMALLEST})


def configure(settings: dict[str, object]) -> None:
    """Change settings of JAX, by their names without ``jax_``."""
    import jax

    for name, value in settings.items():
        jax.config.update(f"jax_{name}", value)  # type: ignore[no-untyped-call]
