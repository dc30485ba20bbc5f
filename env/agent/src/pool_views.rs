//! Pictures and cameras of the environments of a pool.

use crate::AgentError;
use crate::env_pool::EnvPool;
use graspbox_vision::PictureConfig;
use nalgebra::Isometry3;
use rayon::prelude::*;

/// A camera, and where it is in every environment.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPoses {
    /// Its name.
    pub name: String,
    /// Rows of the matrix that takes a camera-frame point to homogeneous image positions.
    pub intrinsics: [f64; 9],
    /// One pose per environment.
    pub world_from_camera: Vec<Isometry3<f64>>,
}

impl EnvPool {
    /// Pictures (n, H, W, 3) of environments `envs` as they stand.
    ///
    /// # Errors
    /// As [`EnvPool::env`], an environment without an episode, or one that cannot be rendered.
    pub fn pictures(&self, envs: &[usize], picture: &PictureConfig) -> Result<Vec<u8>, AgentError> {
        let made = envs.par_iter().map(|&env| {
            let locked = self.env(env)?;
            let episode = locked.episode().ok_or(AgentError::NotReset { env })?;
            Ok(self.spec().observer.picture(&episode.scene_pose()?, &episode.viewpoint().light, picture)?)
        });
        let made: Vec<_> = made.collect();
        Ok(made.into_iter().collect::<Result<Vec<_>, AgentError>>()?.concat())
    }

    /// Every camera as it stands, in the order of the config.
    ///
    /// # Errors
    /// An environment without an episode, or one that was sent off.
    pub fn cameras(&self) -> Result<Vec<CameraPoses>, AgentError> {
        let observer = &self.spec().observer;
        let mut poses = vec![Vec::with_capacity(self.len()); observer.mounted_cameras().len()];
        for env in 0..self.len() {
            let locked = self.env(env)?;
            let episode = locked.episode().ok_or(AgentError::NotReset { env })?;
            let hand = episode.episode().world().world_from_hand();
            for (poses, camera) in poses.iter_mut().zip(observer.cameras(episode.viewpoint(), &hand)?) {
                poses.push(*camera.world_from_camera());
            }
        }
        let cameras = observer.config().cameras.iter().zip(observer.mounted_cameras()).zip(poses);
        Ok(cameras
            .map(|((camera, lens), world_from_camera)| CameraPoses {
                name: camera.name.clone(),
                intrinsics: lens.intrinsics().matrix(),
                world_from_camera,
            })
            .collect())
    }
}
