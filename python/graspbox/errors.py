"""Exceptions of graspbox; the core raises these too, each with a sentence that says what to do."""


class GraspboxError(Exception):
    """Base class of the errors that graspbox raises on purpose."""


class ConfigError(GraspboxError, ValueError):
    """An argument or a configuration value is invalid."""


class FileError(GraspboxError, OSError):
    """A file or folder cannot be read or written; ``errno`` and ``filename`` tell why and which."""


class MeshError(GraspboxError, ValueError):
    """A mesh, or the file that should hold one, is wrong."""


class HandError(GraspboxError, ValueError):
    """The files that describe a hand are wrong; the message names every line."""


class PlanError(GraspboxError, ValueError):
    """Nothing can be planned for this object or hand, or a file holds no plan."""


class SimulationError(GraspboxError, RuntimeError):
    """An object cannot be simulated, or does not come to rest."""


class ObjectSetError(GraspboxError, ValueError):
    """A description of an object set names nothing that exists."""


class MissingExtraError(GraspboxError, ImportError):
    """A package of one of the extras is not installed; the message names the extra."""


class ConnectionLostError(GraspboxError, ConnectionError):
    """A server cannot be reached, or the session on it is lost; the message names the server."""


class InternalError(GraspboxError, RuntimeError):
    """A defect of graspbox itself; please report it together with the input."""
