"""Demonstrations: episodes of a policy, recorded for imitation learning (extra ``[data]``).

`record` runs a policy in many environments in parallel and keeps the episodes worth imitating; ``graspbox record``
does the same on the command line. The folder holds

| file | contents |
|---|---|
| ``manifest.json`` | settings, environment (``env_spec``), observations, counts |
| ``episodes-00000.parquet``, ... | a row per observation: ``episode``, ``step``, ``observation.NAME``, ``action``, ``reward``, ``terminated``, ``truncated`` |

The last row of an episode holds its last observation; its columns of an action and its result are null. Each file is
written atomically; an interrupted recording resumes after the last one. Neither the episodes nor the bytes of the
files depend on the number of environments or threads.

`Demonstrations` reads them, `graspbox.tools.demonstrations` converts them to the formats of Minari and LeRobot, and
``graspbox train clone`` trains a policy of Stable-Baselines3 on them.

>>> import graspbox.data.episodes as demonstrations
>>> made = demonstrations.record("expert", "out/shown", objects="procedural:can:0-3", episodes=2, obs=("proprio",))
>>> [(episode.object, episode.secure) for episode in made.episodes]
[('can-000000', True), ('can-000003', True)]
"""  # noqa: E501 (table)

from graspbox.data.episodes.manifest import Episode
from graspbox.data.episodes.recording import KEEP, record
from graspbox.data.episodes.store import Demonstrations, EpisodeSteps

__all__ = ["KEEP", "Demonstrations", "Episode", "EpisodeSteps", "record"]
