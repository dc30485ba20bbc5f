"""Copy the tracked files to a folder from which a release for a package index is built.

    python scripts/release_tree.py out/release --url https://HOST/OWNER/NAME

The links and pictures of README.md are relative, so that they work in a checkout. A package index renders the page
alone, so this program makes them absolute in the copy: links lead to ``URL/blob/REF/PATH``, pictures to
``URL/raw/REF/PATH``. ``[project.urls]`` of the copy's packages gets the same address, which is not stored in the
repository. Without an address the files are copied unchanged. ``make wheels`` and ``make sdist`` run this program and
build from the copy.
"""

import argparse
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: A link or picture of Markdown that leads to a file of the repository.
_RELATIVE = re.compile(r"(?P<picture>!?)(?P<text>\[[^\]]*\])\((?P<path>(?![a-z]+:|#)[^)\s]+)\)")


def absolute(text: str, url: str, ref: str) -> str:
    """Make the relative links and pictures of a page absolute."""

    def link(match: re.Match[str]) -> str:
        kind = "raw" if match["picture"] else "blob"
        return f"{match['picture']}{match['text']}({url}/{kind}/{ref}/{match['path']})"

    return _RELATIVE.sub(link, text)


def copy_tree(url: str | None, ref: str, out: Path) -> None:
    """Write the copy, with an address if one is given; an earlier copy is replaced."""
    shutil.rmtree(out, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, out / name)
    if url is None:
        return
    readme = out / "README.md"
    readme.write_text(absolute(readme.read_text(), url, ref))
    urls = {"Repository": url, "Changelog": f"{url}/blob/{ref}/CHANGELOG.md"}
    table = "".join(f'{name} = "{value}"\n' for name, value in urls.items())
    for project in (out / "pyproject.toml", out / "packages/policies/pyproject.toml"):
        project.write_text(f"{project.read_text()}\n[project.urls]\n{table}")


def main() -> None:
    """Run the command line."""
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the copy, which is replaced")
    parser.add_argument("--url", help="address of the published repository")
    parser.add_argument("--ref", default=f"v{version}", help="tag, branch or commit that links lead to (%(default)s)")
    args = parser.parse_args()
    if args.url is not None and not re.fullmatch(r"https://[^/\s]+/\S+[^/\s]", args.url):
        parser.error(f"the address is {args.url!r}; give it as https://HOST/OWNER/NAME, without a slash at its end")
    copy_tree(args.url, args.ref, args.out)
    print(f"wrote {args.out}, with {f'links to {args.url} at {args.ref}' if args.url else 'relative links'}")


if __name__ == "__main__":
    main()
