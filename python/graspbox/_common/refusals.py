"""Unusable objects: errors that concern one object, and their representation in results.

Work on a set of objects leaves such an object out and continues; its result has ``refused``, the reason by name.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from graspbox.errors import GraspboxError, InternalError, MeshError, PlanError, SimulationError

__all__ = ["errors_of", "is_refusal", "reason"]


@contextmanager
def errors_of(name: str) -> Iterator[None]:
    """Mark errors of a block that only the object `name` can cause (`GraspboxError.object`)."""
    try:
        yield
    except InternalError:
        raise
    except GraspboxError as error:
        error.object = name
        raise


def is_refusal(error: GraspboxError) -> bool:
    """Return whether an error concerns one object: another object might be usable with the same settings."""
    return error.object is not None or isinstance(error, MeshError | PlanError | SimulationError)


def reason(error: GraspboxError, path: Path | None) -> str:
    """Describe why an object cannot be used: the error, with its class and the object's mesh file."""
    text = f"{type(error).__name__}: {error}"
    return text if path is None or str(path) in text else f"{text} ({path})"
