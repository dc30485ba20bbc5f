"""The protocol: lists the tools, checks calls, and runs them one at a time in a separate process."""

import base64
import json
import logging
import os
import signal
from functools import cache
from typing import Any

from graspbox import _core
from graspbox._common.imports import imported
from graspbox.errors import FileError, GraspboxError, InternalError
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import read_depth_policy
from graspbox.tools.mcp.settings import ToolSettings

__all__ = ["ToolServer", "call"]

_log = logging.getLogger(__name__)
#: Content and pictures of an answer; a sentence instead of the content where a call is refused.
_CallResult = tuple[dict[str, Any] | str, tuple[bytes, ...]]


class ToolServer:
    """A server of tools over the Model Context Protocol.

    Attributes
    ----------
    server : mcp.server.Server
        The server of the protocol's official package, for other transports than `run`.
    """

    def __init__(self, settings: ToolSettings) -> None:
        imported("mcp", "tools for agents need the package mcp, from the extra 'mcp'", "mcp")
        from mcp.server import Server

        from graspbox.tools.mcp.tools import TOOLS
        from graspbox.tools.mcp.workspace import Workspace

        self.settings = settings
        Workspace(settings)
        if settings.policy is not None:
            read_depth_policy(folder_of(settings.policy))
        #: Names of the tools.
        self.names = [name for name in TOOLS if name != "grasp_image" or settings.policy is not None]
        self.server: Any = Server(
            "graspbox",
            version=_core.__version__,
            instructions=self._instructions(),
            on_list_tools=self._list,
            on_call_tool=self._call,
        )
        self._limiter: Any = None
        # Scope of the running call, by which it is cancelled.
        self._running: Any = None
        self._leaving = False

    def _instructions(self) -> str:
        return (
            f"Robot grasping: planning, simulation and pictures. Object sets: {', '.join(self.settings.objects)}; mesh "
            f"files and depth images of the server's folder by their relative paths. Hands: "
            f"{', '.join(self.settings.hands)}. Metres, kilograms, radians; the table is the plane z = 0, z up; poses "
            "are 4x4 matrices named parent_from_child. Nothing is written."
        )

    async def _list(self, _context: Any, _parameters: Any) -> Any:
        from mcp import ListToolsResult
        from mcp.types import Tool, ToolAnnotations

        from graspbox.tools.mcp.tools import TOOLS

        annotations = ToolAnnotations(read_only_hint=True, idempotent_hint=True, open_world_hint=False)
        listed = [
            Tool(
                name=name,
                title=TOOLS[name].title,
                description=TOOLS[name].description,
                input_schema=TOOLS[name].arguments.model_json_schema(),
                annotations=annotations,
            )
            for name in self.names
        ]
        return ListToolsResult(tools=listed)

    async def _call(self, _context: Any, parameters: Any) -> Any:
        name = parameters.name
        if name not in self.names:
            return _refusal(f"there is no tool {name[:100]!r}; choose from {', '.join(self.names)}")
        _log.info("%s", name)
        content, pictures = await self._run_in_process(name, parameters.arguments or {})
        if isinstance(content, str):
            _log.info("%s refused: %s", name, content)
            return _refusal(content)
        from mcp.types import CallToolResult, ImageContent, TextContent

        images = [ImageContent(data=base64.b64encode(one).decode(), mime_type="image/png") for one in pictures]
        text = TextContent(text=json.dumps(content, allow_nan=False))
        return CallToolResult(content=[text, *images], structured_content=content)

    async def _run_in_process(self, name: str, arguments: dict[str, Any]) -> _CallResult:
        """Run a tool in the process of the tools; the content of a failure is a sentence."""
        from anyio import BrokenWorkerProcess, CapacityLimiter, fail_after, to_process

        self._limiter = self._limiter or CapacityLimiter(1)
        limit = self.settings.time_limit
        async with self._limiter:
            if self._leaving:
                return "the server is stopping", ()
            try:
                with fail_after(limit) as self._running:
                    result: _CallResult = await to_process.run_sync(
                        call, self.settings, name, arguments, cancellable=True
                    )
                    return result
                return "the server is stopping", ()
            except TimeoutError:
                return f"{name} took more than {limit:g} s and was ended; ask for less, or raise --time-limit", ()
            except BrokenWorkerProcess:
                return f"the process that ran {name} has ended; there may not be enough memory: ask for less", ()
            except Exception:
                _log.exception("%s", name)
                return f"{name} failed through a bug in graspbox; the log of the server has more", ()

    def run(self) -> None:
        """Serve over standard input and output until the client closes them."""
        import anyio
        from mcp.server.stdio import stdio_server

        async def serve() -> None:
            async with anyio.create_task_group() as group:
                group.start_soon(self._leave)
                async with stdio_server() as (reader, writer):
                    await self.server.run(reader, writer, self.server.create_initialization_options())
                group.cancel_scope.cancel()

        anyio.run(serve)

    async def _leave(self) -> None:
        """End this process after Ctrl-C or SIGTERM, with the running call.

        The thread that reads standard input cannot be ended, and would be waited for.
        """
        from anyio import open_signal_receiver

        with open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
            async for number in signals:
                self._leaving = True
                if self._running is not None:
                    self._running.cancel()
                if self._limiter is not None:
                    async with self._limiter:
                        pass
                logging.shutdown()
                os._exit(128 + number)


def _refusal(sentence: str) -> Any:
    """Answer with an error of a tool, which agents can read."""
    from mcp.types import CallToolResult, TextContent

    return CallToolResult(content=[TextContent(text=sentence)], is_error=True)


@cache
def _workspace(settings: ToolSettings) -> Any:
    from graspbox.tools.mcp.workspace import Workspace

    return Workspace(settings)


def call(settings: ToolSettings, name: str, arguments: dict[str, Any]) -> _CallResult:
    """Check and run one call in this process; an error becomes a sentence, with files relative to the folder."""
    from graspbox.tools.mcp.arguments import parsed
    from graspbox.tools.mcp.tools import TOOLS

    tool = TOOLS[name]
    try:
        answer = tool.run(_workspace(settings), parsed(tool.arguments, arguments))
    except InternalError:
        raise
    except GraspboxError as error:
        text = f"{error.filename}: {error.strerror}" if isinstance(error, FileError) else str(error)
        return text.replace(f"{settings.folder}/", "").replace(str(settings.folder), "."), ()
    except MemoryError:
        return "there is not enough memory; ask for less", ()
    return answer.content, answer.pictures
