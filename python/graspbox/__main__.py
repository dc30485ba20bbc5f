"""The ``graspbox`` command; needs the extra ``cli``."""

import sys

#: Packages of the extra ``cli`` that every command needs.
_CLI_MODULES = ("typer", "rich")


def main() -> None:
    """Run the command line; exits with status 2 and names the missing extra if the command cannot be imported."""
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
