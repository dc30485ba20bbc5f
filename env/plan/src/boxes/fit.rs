//! Fitting one box to a cloud.

use super::minimum::least_volume_axes;
use super::moments::{CloudFrame, mean, with_invariant_signs};
use super::obb::OrientedBox;
use crate::PlanError;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// The fit of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fit {
    /// Principal axes of the points: fast; the volume is 5 % above the least one in the median, and 60 % at worst.
    Pca,
    /// The least volume, within 0.2 % of the best known.
    #[default]
    Minimum,
}

/// Fits a box around `points` (metres), in their frame.
///
/// The box contains every point. It depends only on the points, not on their frame: the longest side comes first, and the
/// signs of the axes follow the cloud's third moments.
///
/// # Errors
/// [`PlanError::Degenerate`] for points on one plane, [`PlanError::NotFinite`] for a bad coordinate.
pub fn fit_box(points: &[Point3<f64>], fit: Fit) -> Result<OrientedBox, PlanError> {
    check_cloud(points)?;
    Ok(fit_cloud(points, &[], fit))
}

/// Checks that points are finite and span a volume.
pub(crate) fn check_cloud(points: &[Point3<f64>]) -> Result<(), PlanError> {
    /// A cloud thinner than this share of its length is flat: about ten times the rounding of 32-bit coordinates.
    const FLAT: f64 = 1e-6;
    if let Some(index) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(PlanError::NotFinite { index });
    }
    if points.len() < 4 {
        return Err(PlanError::Degenerate { count: points.len() });
    }
    let bounds = OrientedBox::around(&CloudFrame::of(points).axes, points);
    if bounds.half_extents.z <= FLAT * bounds.half_extents.x {
        return Err(PlanError::Degenerate { count: points.len() });
    }
    Ok(())
}

/// Fits a box around `samples` (at least one), which define the principal axes, and `more`. Flat clouds get flat boxes.
pub(crate) fn fit_cloud(samples: &[Point3<f64>], more: &[Point3<f64>], fit: Fit) -> OrientedBox {
    let axes = match fit {
        Fit::Pca => CloudFrame::of(samples).axes,
        Fit::Minimum => least_volume_axes(samples, more),
    };
    let all = || samples.iter().chain(more);
    let bounds = OrientedBox::around(&axes, all());
    let axes = with_invariant_signs(&bounds.axes, &mean(samples), samples);
    OrientedBox { axes, ..bounds }
}
