"""Policies on servers, for the commands that measure policies: their options, and the policy of a name or a URL."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import typer

from graspbox.envs.remote_config import client_token
from graspbox.errors import ConfigError
from graspbox.policies import Policy, load
from graspbox.policies.remote_policy import RemotePolicy

__all__ = ["CaFile", "Chunk", "Keys", "Obs", "PolicyServers", "ServerToken", "is_url"]

ServerToken = Annotated[
    str | None,
    typer.Option(help="File with the token of the servers that are named; by default the variable GRASPBOX_TOKEN."),
]
CaFile = Annotated[
    str | None, typer.Option(help="Certificates to trust besides those of the public authorities, a PEM file.")
]
Obs = Annotated[
    list[str] | None,
    typer.Option(help="Observation for a policy on a server; repeatable; by default those that it names."),
]
Keys = Annotated[
    list[str] | None,
    typer.Option("--key", metavar="OURS=THEIRS", help="Name under which that server expects an observation."),
]
Chunk = Annotated[int, typer.Option(min=1, max=1000, help="Actions of its answer that are executed before the next.")]


def is_url(policy: str) -> bool:
    """Return whether a policy is named by the address of a server."""
    return policy.startswith(("ws://", "wss://"))


@dataclass(frozen=True)
class PolicyServers:
    """The options of policies on servers."""

    obs: list[str] | None = None
    keys: list[str] | None = None
    chunk: int = 1
    token_file: str | None = None
    ca_file: str | None = None

    def check(self, policies: Iterable[str], remote: bool = False) -> None:
        """Refuse options of servers without a server, and keys that are no pairs; `remote`: of environments."""
        served = any(map(is_url, policies))
        if (self.token_file or self.ca_file) and not remote and not served:
            raise ConfigError("--token-file and --ca-file are for servers; name one by --remote, or as ws://HOST:PORT")
        if (self.obs or self.keys or self.chunk != 1) and not served:
            raise ConfigError("--obs, --key and --chunk are for a policy on a server; name one as ws://HOST:PORT")
        if not all(self._pairs().values()):
            raise ConfigError(f"--key is {self.keys}; write it as OURS=THEIRS, such as depth=observation/depth")

    def load(self, policy: str, rehearsed: int | None = None) -> Policy:
        """Load the policy of a name or a folder, or connect to that of a server, which cannot rehearse grasps."""
        if not is_url(policy):
            return load(policy, rehearsed=rehearsed)
        if rehearsed is not None:
            raise ConfigError("--rehearse is for policies of this machine; the server's rehearses as its folder says")
        token, names = client_token(self.token_file), tuple(self.obs) if self.obs else None
        return RemotePolicy(policy, obs=names, keys=self._pairs(), chunk=self.chunk, token=token, ca=self.ca_file)

    def _pairs(self) -> dict[str, str]:
        return dict(pair.partition("=")[::2] for pair in self.keys or ())
