"""The ``graspbox`` command; it needs the extra ``cli``, and names it if it is not installed."""

import sys

#: Packages of the extra ``cli`` that every command needs.
_CLI_MODULES = ("typer", "rich")


def main() -> None:
    """Run the command line, or name the extra that it needs (exit status 2)."""
    from graspbox.errors import MissingExtraError

    try:
        from graspbox.cli import app
    except MissingExtraError as error:
        print(f"graspbox: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in _CLI_MODULES:
            raise
        print(
            f"graspbox: the command line needs {error.name}, from the extra 'cli': pip install 'graspbox[cli]'",
            file=sys.stderr,
        )
        raise SystemExit(2) from None
    app()


if __name__ == "__main__":
    main()
