"""Tools for agents over the Model Context Protocol (extra ``mcp``): read-only, within one folder.

| tool | answer |
|---|---|
| ``plan``        | boxes around an object and ranked grasps; picture of boxes and grasps |
| ``simulate``    | outcomes of grasps in simulation; picture of the stages of one trial |
| ``look``        | size, mass and resting pose of an object; picture of it on the table, or with a hand at a grasp |
| ``grasp_image`` | grasps of the object in a depth image, by a published policy; picture of image and best grasp |

An answer is structured JSON, the same JSON as text, and PNG pictures. Lengths are in metres, masses in kilograms. Tools
run one at a time in a separate process, which is ended after the time limit.
"""

from graspbox.tools.mcp.serving import ToolServer
from graspbox.tools.mcp.settings import ToolSettings

__all__ = ["ToolServer", "ToolSettings"]
