"""Upload of published policies to the Hugging Face hub (extra ``hub``)."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from graspbox._common.files import dumps
from graspbox.errors import ConfigError
from graspbox.policies.published.configs import Use
from graspbox.policies.published.downloads import CARD, CONFIG, LICENCE, download, hub, is_name, repository
from graspbox.policies.published.folders import file_hash, load
from graspbox.policies.published.schema import content_of

__all__ = ["push_to_hub"]


def push_to_hub(
    folder: str | os.PathLike[str], name: str, *, uses: Mapping[str, str] | None = None, private: bool = False
) -> str:
    """Upload a published policy to the repository ``owner/name``, which is created if needed.

    Parameters
    ----------
    folder : str or path
        Its folder.
    name : str
        ``owner/name``.
    uses : mapping of str to str, optional
        Names on the hub, ``hf://owner/name@revision``, of the policies that it uses, by their role; required if its
        ``config.json`` refers to a local folder.
    private : bool
        Whether a new repository is private.

    Returns
    -------
    str
        ``hf://owner/name@revision``, for `graspbox.policies.load`.

    Raises
    ------
    ConfigError
        If the folder holds no complete policy, a policy that it uses is not on the hub or differs there, or the
        hub refuses the upload.
    MissingExtraError
        If huggingface_hub is not installed.
    """
    folder = Path(folder)
    repo, _ = repository(f"hf://{name}")
    library, config = hub(), load(folder)
    used = {role: _used(role, use, (uses or {}).get(role, use.policy)) for role, use in config.uses.items()}
    text = dumps(content_of(replace(config, uses=used))) + "\n"
    beside = (path for path in folder.iterdir() if path.name in (CARD, LICENCE) or path.suffix == ".png")
    contents = {CONFIG: text.encode(), **{path.name: path for path in beside}}
    contents |= {name: folder / name for name in config.holds}
    add = library.CommitOperationAdd
    operations = [add(path_in_repo=name, path_or_fileobj=content) for name, content in sorted(contents.items())]
    api = library.HfApi()
    try:
        api.create_repo(repo, private=private, exist_ok=True)
        done = api.create_commit(repo, operations=operations, commit_message=f"Publish {config.name}")
    except library.errors.HfHubHTTPError as error:
        raise ConfigError(f"the hub refuses {repo}: {str(error).splitlines()[0]}; see `hf auth login`") from None
    return f"hf://{repo}@{done.oid}"


def _used(role: str, use: Use, name: str) -> Use:
    """Return the reference to a used policy on the hub, after a check that it is the same."""
    if not is_name(name):
        raise ConfigError(
            f"uses.{role}.policy is {name!r}, which the hub does not have; push that policy first and pass "
            f"uses={{{role!r}: 'hf://owner/name@revision'}}"
        )
    if file_hash(download(name) / CONFIG) != use.sha256:
        raise ConfigError(f"{name} is another policy than the one that is used as {role!r}; push that one")
    return Use(name, use.sha256)
