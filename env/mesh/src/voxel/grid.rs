//! The cube that is cut into voxels, and which of them are set.

use crate::error::{MeshError, require};
use crate::range::in_range;
use nalgebra::{Point3, Vector3};

/// Most voxels along a side: binvox's own limit; a grid of it takes 1 GiB.
pub const MAX_RESOLUTION: usize = 1024;

/// Refuses a number of voxels along a side.
pub(super) fn check_resolution(resolution: usize) -> Result<(), MeshError> {
    Ok(in_range("resolution", resolution as f64, 1.0..=MAX_RESOLUTION as f64, "voxels per side")?)
}

/// A vector of `count` equal values; unlike `vec!`, it does not abort the process when memory runs out.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
pub(super) fn filled<T: Copy>(count: usize, value: T) -> Result<Vec<T>, MeshError> {
    let mut all = with_room(count)?;
    all.resize(count, value);
    Ok(all)
}

/// An empty vector with room for `count` values.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
pub(super) fn with_room<T>(count: usize) -> Result<Vec<T>, MeshError> {
    let mut all = Vec::new();
    all.try_reserve_exact(count).map_err(|_| out_of_memory::<T>(count))?;
    Ok(all)
}

/// The error of an allocation of `count` values.
pub(super) fn out_of_memory<T>(count: usize) -> MeshError {
    MeshError::OutOfMemory { what: "voxels", bytes: (count as u64).saturating_mul(size_of::<T>() as u64) }
}

/// A cube of n x n x n voxels, aligned with the axes of its frame (for a mesh: the object's, metres).
///
/// Voxel (i, j, k) has its centre at `origin + (i + 0.5, j + 0.5, k + 0.5) * voxel_size()` and the flat index `(i * n + j) * n + k`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelFrame {
    resolution: usize,
    origin: Point3<f64>,
    side: f64,
}

impl VoxelFrame {
    /// A cube with its least corner at `origin` and sides of `side` metres.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`] for the resolution; [`MeshError::BadParameter`] for corners that are not finite or a side that is not
    /// positive.
    pub fn new(resolution: usize, origin: Point3<f64>, side: f64) -> Result<Self, MeshError> {
        check_resolution(resolution)?;
        let far = origin + Vector3::repeat(side);
        if let Some(&value) = origin.iter().chain(far.iter()).find(|x| !x.is_finite()) {
            require(false, "a corner of the voxel grid", value, "it must be finite")?;
        }
        let rule = "it must be positive; a mesh that is a single point has no voxels";
        require(side / resolution as f64 > 0.0, "the side of the voxel grid", side, rule)?;
        Ok(Self { resolution, origin, side })
    }

    /// Voxels along each side.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.resolution.pow(3)
    }

    /// Least corner of the cube, metres.
    pub fn origin(&self) -> Point3<f64> {
        self.origin
    }

    /// Side of the cube, metres: the `scale` of a binvox file.
    pub fn side(&self) -> f64 {
        self.side
    }

    /// Side of a voxel, metres.
    pub fn voxel_size(&self) -> f64 {
        self.side / self.resolution as f64
    }

    /// Flat index of voxel (i, j, k).
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.resolution + j) * self.resolution + k
    }

    /// Centre of voxel (i, j, k), metres.
    pub fn center(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(at.map(|i| i as f64 + 0.5)) * self.voxel_size()
    }

    /// The voxel that holds `p`; none beyond the cube. A point between two voxels belongs to the greater one.
    pub fn voxel(&self, p: &Point3<f64>) -> Option<[usize; 3]> {
        let at = self.to_grid(p);
        let within = |x: f64| (0.0..self.resolution as f64).contains(&x);
        at.iter().all(|&x| within(x)).then(|| at.map(|x| x as usize))
    }

    /// `p` in voxels from the least corner.
    pub fn to_grid(&self, p: &Point3<f64>) -> [f64; 3] {
        let size = self.voxel_size();
        [0, 1, 2].map(|k| (p[k] - self.origin[k]) / size)
    }
}

/// Voxels that are set or not.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    frame: VoxelFrame,
    set: Vec<bool>,
}

impl VoxelGrid {
    /// Takes one flag for each voxel, in the order of [`VoxelFrame::index`].
    ///
    /// # Errors
    /// [`MeshError::BadParameter`] when there are fewer or more flags than voxels.
    pub fn new(frame: VoxelFrame, set: Vec<bool>) -> Result<Self, MeshError> {
        let rule = "it must be the cube of the resolution";
        require(set.len() == frame.len(), "the number of voxels", set.len() as f64, rule)?;
        Ok(Self { frame, set })
    }

    /// Place of the voxels.
    pub fn frame(&self) -> &VoxelFrame {
        &self.frame
    }

    /// Whether each voxel is set, in the order of [`VoxelFrame::index`].
    pub fn flags(&self) -> &[bool] {
        &self.set
    }

    /// The flags without the frame.
    pub fn into_flags(self) -> Vec<bool> {
        self.set
    }

    /// Number of voxels that are set.
    pub fn count(&self) -> usize {
        self.set.iter().filter(|set| **set).count()
    }

    /// Volume of the voxels that are set, m3.
    pub fn volume(&self) -> f64 {
        self.count() as f64 * self.frame.voxel_size().powi(3)
    }

    /// The grid of half the resolution; a voxel is set where at least `min_parts` of its eight parts are.
    ///
    /// # Errors
    /// [`MeshError::OutOfMemory`].
    pub(super) fn halved(&self, min_parts: u8) -> Result<Self, MeshError> {
        let n = self.frame.resolution;
        let frame = VoxelFrame { resolution: n / 2, ..self.frame };
        let mut parts = filled(frame.len(), 0_u8)?;
        for (row, cells) in self.set.chunks_exact(n).enumerate() {
            let start = frame.index([row / n / 2, row % n / 2, 0]);
            for (part, pair) in parts[start..].iter_mut().zip(cells.as_chunks::<2>().0) {
                *part += u8::from(pair[0]) + u8::from(pair[1]);
            }
        }
        let mut set = with_room(frame.len())?;
        set.extend(parts.into_iter().map(|count| count >= min_parts));
        Self::new(frame, set)
    }

    /// Clears the voxels whose six neighbours are set.
    ///
    /// # Errors
    /// [`MeshError::OutOfMemory`].
    pub(super) fn remove_internal(&mut self) -> Result<(), MeshError> {
        let n = self.frame.resolution;
        let mut before = with_room(self.set.len())?;
        before.extend_from_slice(&self.set);
        // Voxels at the border have a neighbour beyond it, which is empty.
        for i in 1..n.saturating_sub(1) {
            for j in 1..n - 1 {
                for k in 1..n - 1 {
                    let at = self.frame.index([i, j, k]);
                    let neighbors = [at - n * n, at + n * n, at - n, at + n, at - 1, at + 1];
                    self.set[at] &= !neighbors.iter().all(|&other: &usize| before[other]);
                }
            }
        }
        Ok(())
    }
}
