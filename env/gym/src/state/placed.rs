//! Objects of a scene at rest.

use crate::state::bounds::{FARTHEST, StateBounds};
use graspbox_mesh::range::{OutOfRange, in_range, is_pose};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// An object of a scene at rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Placed {
    /// Its place in the order of labels.
    pub slot: u32,
    /// Its index in the set of objects.
    pub object: usize,
    pub scale: f64,
    /// Its pose.
    pub world_from_object: Isometry3<f64>,
}

impl Placed {
    /// Refuses objects that no scene within `bounds` can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(all: &[Self], bounds: &StateBounds) -> Result<(), OutOfRange> {
        let (most, [low, high]) = (bounds.objects as f64, bounds.scales);
        in_range("number of objects", all.len() as f64, 1.0..=most, "")?;
        for placed in all {
            in_range("objects.slot", f64::from(placed.slot), 0.0..=most - 1.0, "")?;
            in_range("objects.scale", placed.scale, low..=high, "")?;
            is_pose("objects.world_from_object", &placed.world_from_object, FARTHEST)?;
        }
        Ok(())
    }
}

/// A target among other objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TargetScene {
    /// The objects of the scene as the episode begins, in its order. The target is the first in the order of labels.
    pub objects: Vec<Placed>,
    pub target: u32,
}

impl TargetScene {
    /// * `share`: of the objects before the target, in [0, 1).
    pub(crate) fn new(mut objects: Vec<Placed>, share: f64) -> Self {
        let target = ((share * objects.len() as f64) as usize).min(objects.len().saturating_sub(1));
        for (index, placed) in objects.iter_mut().enumerate() {
            placed.slot = match index {
                _ if index == target => 0,
                _ if index < target => index as u32 + 1,
                _ => index as u32,
            };
        }
        Self { objects, target: target as u32 }
    }

    /// Number of the other objects.
    pub fn neighbours(&self) -> usize {
        self.objects.len().saturating_sub(1)
    }

    /// Refuses states that no episode within `bounds` can have.
    ///
    /// * `object`: index of the episode's object in the set.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, object: usize, bounds: &StateBounds) -> Result<(), OutOfRange> {
        Placed::check(&self.objects, bounds)?;
        in_range("target_scene.target", f64::from(self.target), 0.0..=(self.objects.len() - 1) as f64, "")?;
        let target = self.objects[self.target as usize].object as f64;
        in_range("target_scene.objects[target].object", target, object as f64..=object as f64, "")
    }
}
