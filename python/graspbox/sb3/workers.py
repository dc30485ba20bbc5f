"""Workers of Stable-Baselines3's ``SubprocVecEnv`` know the ids of the environments once this module is imported."""

from stable_baselines3.common.vec_env.base_vec_env import CloudpickleWrapper

from graspbox._common.imports import import_in_workers

import_in_workers(CloudpickleWrapper)
