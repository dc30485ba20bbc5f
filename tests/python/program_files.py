"""Programs of the repository as modules, for tests that call them."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

__all__ = ["imported"]


def imported(path: Path) -> ModuleType:
    """Import a program without running it; its neighbours can be imported, as where it runs."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up there.
    sys.modules[path.stem] = module
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(path.parent), *sys.path])
        spec.loader.exec_module(module)
    return module
