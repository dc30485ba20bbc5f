"""The ``graspbox`` command; needs the extra ``cli``, except for ``--help`` and ``--version``."""

from graspbox.cli import app as main

if __name__ == "__main__":
    main()
