//! Fitting one box to a cloud.

use super::minimum::least_volume_axes;
use super::moments::{CloudFrame, mean, with_invariant_signs};
use super::obb::OrientedBox;
use crate::PlanError;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// How a box is fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fit {
    /// Axes from principal components of the points: fast, 5 % above the least volume in the median and 60 % at worst.
    Pca,
    /// The least volume, within 0.2 % of the best known.
    #[default]
    Minimum,
}

/// Fits a box around `points` (metres); its frame is theirs.
///
/// The box holds every point. It depends on the points alone, not on the frame they are given in: the longest side comes first, and the
/// signs of the axes follow the cloud's third moments.
///
/// # Errors
/// [`PlanError::Degenerate`] for points on one plane, [`PlanError::NotFinite`] for a bad coordinate.
pub fn fit_box(points: &[Point3<f64>], fit: Fit) -> Result<OrientedBox, PlanError> {
    check_cloud(points)?;
    Ok(fit_cloud(points, &[], fit))
}

/// Finite points that span a volume, or the error that says which rule they break.
pub(crate) fn check_cloud(points: &[Point3<f64>]) -> Result<(), PlanError> {
    /// Thinner than this share of its length, a cloud is flat: about the rounding of coordinates stored in 32 bits.
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

/// Fits a box around `samples` (at least one), which give the principal axes, and around `more`. Flat clouds get flat boxes.
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
