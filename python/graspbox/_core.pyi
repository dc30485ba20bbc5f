"""The Rust core; everything here is wrapped by a public function of the package."""

__all__ = ["__version__", "_spin", "num_threads"]

__version__: str

def num_threads() -> int: ...
def _spin(seconds: float, *, num_threads: int | None = None, deaf: bool = False, fail: bool = False) -> int: ...
