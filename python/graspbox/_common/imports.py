"""Imports on demand: packages of the extras, work that waits until a module is imported, graspbox in workers."""

import copyreg
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from graspbox.errors import MissingExtraError

__all__ = ["after_import", "import_in_workers", "imported"]


def imported(module: str, need: str, extra: str) -> Any:
    """Import a module; a `MissingExtraError` says what needs its package, and which extra installs it."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != module.partition(".")[0]:
            raise
        raise MissingExtraError(f"{need}: pip install 'graspbox[{extra}]'") from None


def after_import(module: str, work: Callable[[], None]) -> None:
    """Call a function once a top-level module has been imported: now if it is, else after its first import.

    A hook, since Gymnasium 1.0 removed its entry points for environments (``gymnasium.envs``): it imports no plugin
    now, and an import of Gymnasium by graspbox would take most of the 0.1 s in which ``graspbox --help`` answers.
    """
    if module in sys.modules:
        work()
    else:
        sys.meta_path.insert(0, _Finder(module, work))


def import_in_workers(wrapper: type) -> None:
    """Let every process that loads a pickled object of a class import graspbox first.

    Gymnasium and Stable-Baselines3 wrap the functions that make environments, and send them to worker processes, which
    begin without graspbox and know none of its ids. The pickle of a wrapper now names a function of this module.
    """
    copyreg.pickle(wrapper, _reduced)


def _reduced(wrapped: Any) -> tuple[Any, ...]:
    return _made, (type(wrapped),), wrapped.__getstate__()


def _made(kind: type) -> Any:
    return object.__new__(kind)


class _Finder(MetaPathFinder):
    """Finds the module as the other finders do, and calls the function after the module has run."""

    def __init__(self, module: str, work: Callable[[], None]) -> None:
        self._module, self._work, self._asks_others = module, work, False

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._module or self._asks_others:
            return None
        self._asks_others = True
        try:
            spec = find_spec(fullname)
        finally:
            self._asks_others = False
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def run(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    self._work()

            spec.loader.exec_module = run  # type: ignore[method-assign]
        return spec
