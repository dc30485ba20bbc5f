"""A local server with the part of the Hugging Face hub's API that huggingface_hub needs to load and push."""

import base64
import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

#: Files of each revision of each repository.
Repositories = dict[str, dict[str, dict[str, bytes]]]


class Hub(ThreadingHTTPServer):
    """The server; ``repositories`` has its contents, a commit being a hash of its files."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.repositories: Repositories = {}
        self.requests: list[str] = []
        #: Sizes that it states instead of the true ones, by file.
        self.stated: dict[str, int] = {}

    @property
    def url(self) -> str:
        """Its address."""
        return f"http://127.0.0.1:{self.server_address[1]}"

    def commit(self, repository: str, files: dict[str, bytes]) -> str:
        """Make a commit of the branch main; its name."""
        commits = self.repositories.setdefault(repository, {})
        merged = {**commits.get("main", {}), **files}
        name = hashlib.sha1(repr(sorted(merged.items())).encode()).hexdigest()
        commits["main"] = commits[name] = merged
        return name


@contextmanager
def running() -> Iterator[Hub]:
    """Run a server in a thread."""
    with Hub() as hub:
        thread = threading.Thread(target=hub.serve_forever, daemon=True)
        thread.start()
        try:
            yield hub
        finally:
            hub.shutdown()
            thread.join()


class _Handler(BaseHTTPRequestHandler):
    server: Hub
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        self.server.requests.append(format % args)

    def _answer(self, status: int, content: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": "application/json", **(headers or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def _json(self, value: Any, status: int = 200) -> None:
        self._answer(status, json.dumps(value).encode())

    def _missing(self, code: str) -> None:
        self._answer(404, b"{}", {"X-Error-Code": code, "X-Error-Message": "not found"})

    def _commit(self, repository: str, revision: str) -> tuple[str, dict[str, bytes]] | None:
        commits = self.server.repositories.get(repository)
        if commits is None:
            self._missing("RepoNotFound")
            return None
        if revision not in commits:
            self._missing("RevisionNotFound")
            return None
        files = commits[revision]
        return next(name for name, held in commits.items() if held is files and name != "main"), files

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        if found := re.fullmatch(r"/api/models/([^/]+/[^/]+)(?:/revision/([^/]+))?", path):
            if (commit := self._commit(found[1], found[2] or "main")) is not None:
                sha, files = commit
                sizes = {name: self.server.stated.get(name, len(content)) for name, content in files.items()}
                siblings = [
                    {"rfilename": name, **({"size": size} if "blobs" in query else {})} for name, size in sizes.items()
                ]
                self._json({"id": found[1], "sha": sha, "siblings": siblings})
        elif found := re.fullmatch(r"/api/models/([^/]+/[^/]+)/tree/([^/]+)", path):
            if (commit := self._commit(found[1], found[2])) is not None:
                rows = [
                    {"type": "file", "path": name, "size": len(content), "oid": hashlib.sha1(content).hexdigest()}
                    for name, content in commit[1].items()
                ]
                self._json(rows)
        elif found := re.fullmatch(r"/([^/]+/[^/]+)/resolve/([^/]+)/(.+)", path):
            if (commit := self._commit(found[1], found[2])) is not None:
                sha, files = commit
                if found[3] not in files:
                    self._missing("EntryNotFound")
                    return
                content = files[found[3]]
                tag = hashlib.sha1(content).hexdigest()
                self._answer(200, content, {"ETag": f'"{tag}"', "X-Repo-Commit": sha, "Content-Type": "text/plain"})
        else:
            self._missing("EntryNotFound")

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if self.path == "/api/validate-yaml":
            self._json({"errors": [], "warnings": []})
        elif self.path == "/api/repos/create":
            given = json.loads(body)
            name = f"{given.get('organization') or 'somebody'}/{given['name']}"
            self.server.repositories.setdefault(name, {})
            self._json({"url": f"{self.server.url}/{name}"})
        elif found := re.fullmatch(r"/api/models/([^/]+/[^/]+)/preupload/main", self.path.partition("?")[0]):
            files = json.loads(body)["files"]
            self._json({"files": [{"path": f["path"], "uploadMode": "regular", "shouldIgnore": False} for f in files]})
        elif found := re.fullmatch(r"/api/models/([^/]+/[^/]+)/commit/main", self.path.partition("?")[0]):
            lines = [json.loads(line) for line in body.splitlines()]
            written = [line["value"] for line in lines if line["key"] == "file"]
            files = {value["path"]: base64.b64decode(value["content"]) for value in written}
            sha = self.server.commit(found[1], files)
            self._json({"success": True, "commitOid": sha, "commitUrl": f"{self.server.url}/{found[1]}/commit/{sha}"})
        else:
            self._missing("EntryNotFound")
