"""Episodes of demonstrations (`graspbox.data.episodes`) as replays."""

from itertools import islice

import numpy as np

from graspbox import object_sets
from graspbox.data.episodes import Demonstrations
from graspbox.errors import ConfigError
from graspbox.evaluation.replays import Replay

#: Keywords of the environment that a replay sets itself, or that do not determine an episode.
_OWN = ("objects", "obs", "split", "scale", "mass", "num_threads", "render_mode", "picture", "info", "remote")


def of_demonstrations(made: Demonstrations, count: int) -> list[Replay]:
    """Return the first `count` episodes of demonstrations as replays, with the noise of their actions.

    Raises
    ------
    ConfigError
        If they were recorded on a server, or a file is damaged.
    ObjectSetError, MissingExtraError
        If the objects are not on this machine.
    """
    keywords = made.settings["env_spec"]["kwargs"]
    if keywords.get("remote") is not None:
        raise ConfigError("the demonstrations come from a server; recordings need environments of this machine")
    chosen = {name: keywords[name] for name in ("split", "scale", "mass") if keywords.get(name) is not None}
    specs = {spec.name: spec for spec in object_sets.load(keywords.get("objects", "procedural"), **chosen)}
    settings = {name: value for name, value in keywords.items() if name not in _OWN and value is not None}
    noise = float(made.settings.get("noise", 0.0))
    replays = []
    for steps in islice(made.read(()), count):
        episode = steps.episode
        actions = np.clip(steps.actions, -1.0, 1.0)
        if noise:
            # The stream of `graspbox.data.episodes.record`.
            stream = np.random.default_rng(episode.seed)
            actions = actions + np.stack([stream.normal(0.0, noise, actions.shape[1]) for _ in actions])
            actions = np.clip(actions, -1.0, 1.0)
        spec = specs[episode.object]
        facts = (episode.seed, spec.name, spec.source, spec.scale, spec.mass, "" if episode.success else "failure")
        replays.append(Replay(made.settings["env_id"], settings, *facts, actions.astype(np.float32)))
    return replays
