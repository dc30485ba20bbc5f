"""Exceptions of graspbox and its core; each message names the remedy."""


class GraspboxError(Exception):
    """Base class of the errors that graspbox raises on purpose.

    Attributes
    ----------
    object : str or None
        Name of the object that cannot be used, where another object might; None for every other error.
    field : str
        Name of the invalid argument, keyword or entry of a request; empty if unknown or if there are several.
    """

    object: str | None = None
    field: str = ""


class ConfigError(GraspboxError, ValueError):
    """An argument or a configuration value is invalid."""


class UnknownKeywordError(ConfigError, TypeError):
    """An environment has no such keyword; a ``TypeError`` too, as for every function of Python."""


class FileError(GraspboxError, OSError):
    """A file or folder cannot be read or written; ``errno`` gives the reason, ``filename`` the path."""

    def __str__(self) -> str:
        """Return the reason and the path, without the number that ``OSError`` begins with."""
        if self.filename is None or self.strerror is None:
            return super().__str__()
        return f"{self.strerror}: {self.filename}"


class MeshError(GraspboxError, ValueError):
    """A mesh or a mesh file is invalid."""


class HandError(GraspboxError, ValueError):
    """The files that describe a hand are invalid; the message lists every wrong line."""


class ArmError(GraspboxError, ValueError):
    """The files that describe an arm are invalid, or the arm cannot carry the hand."""


class PathError(GraspboxError, RuntimeError):
    """No path of an arm was found.

    Attributes
    ----------
    phase : str
        Where on the path, a name of `graspbox.arms.Trajectory.phases`; empty for a path that is too long, and if none
        was planned.
    reason : str
        ``touches``, ``not_reached``, ``at_limit``, ``singular``, ``no_way``, ``start_beyond_limit``, ``too_long`` or
        ``no_object``.
    failures : tuple of str
        For each grasp that was tried, why no path leads to it.
    """

    def __init__(self, message: str, phase: str = "", reason: str = "", failures: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.phase, self.reason, self.failures = phase, reason, failures


class PlanError(GraspboxError, ValueError):
    """No plan can be made for this object or hand, or a file contains no plan."""


class SimulationError(GraspboxError, RuntimeError):
    """An object cannot be simulated, or does not come to rest."""


class ObjectSetError(GraspboxError, ValueError):
    """The name of an object set is invalid, or its objects cannot be found."""


class MissingExtraError(GraspboxError, ImportError):
    """A package from an extra is not installed; the message names the extra."""


class ConnectionLostError(GraspboxError, ConnectionError):
    """A server cannot be reached, or the session on it is lost; the message names the server."""


class InternalError(GraspboxError, RuntimeError):
    """A bug in graspbox; please report it with the input."""
