//! Bounds of the numbers of a saved state.

/// Bounds of the numbers of a saved state.
pub(crate) struct StateBounds {
    /// Least and greatest preshape.
    pub preshape: [f64; 2],
    pub preshape_unit: &'static str,
    /// Most objects of a scene.
    pub objects: usize,
    /// Least and greatest scale of an object.
    pub scales: [f64; 2],
}

/// Greatest coordinate of a saved pose, metres: farther than anything falls.
pub(crate) const FARTHEST: f64 = 1e5;
