"""Exceptions of graspbox; the core raises these too, each with a sentence that says what to do."""


class GraspboxError(Exception):
    """Base of every error that graspbox raises on purpose."""


class ConfigError(GraspboxError, ValueError):
    """An argument or a configuration value is out of place."""


class FileError(GraspboxError, OSError):
    """A file or folder cannot be read or written; ``errno`` and ``filename`` tell why and which."""


class MeshError(GraspboxError, ValueError):
    """A mesh, or the file that should hold one, is wrong."""


class HandError(GraspboxError, ValueError):
    """The files that describe a hand are wrong; the message names every line."""


class PlanError(GraspboxError, ValueError):
    """Nothing can be planned for this object or hand."""


class SimulationError(GraspboxError, RuntimeError):
    """An object cannot be simulated, or does not come to rest."""


class ObjectSetError(GraspboxError, ValueError):
    """A description of an object set names nothing that exists."""


class MissingExtraError(GraspboxError, ImportError):
    """A package is missing that one of the extras brings; the message names the extra."""


class InternalError(GraspboxError, RuntimeError):
    """A defect of graspbox itself; please report it together with the input."""
