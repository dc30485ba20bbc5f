//! The images that a camera takes.

use crate::{Camera, Intrinsics};

/// Images of one camera, row by row from the upper left pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    pub(crate) camera: Option<Camera>,
    /// (H, W): metres along the optical axis (not along the ray); 0 for background.
    pub depth: Vec<f32>,
    /// (H, W, 3): red, green, blue; empty unless requested.
    pub rgb: Vec<u8>,
    /// (H, W): the label of the visible instance, 0 for background; empty unless requested.
    pub segmentation: Vec<u8>,
}

impl Frame {
    /// The camera that took it; `None` before anything was rendered.
    #[must_use]
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        let size = |k: &Intrinsics| [k.width as usize, k.height as usize];
        self.camera.as_ref().map_or([0, 0], |c| size(c.intrinsics()))
    }

    /// (H, W, 3): the visible point at each pixel in the camera's frame, metres; zeros for background.
    pub fn points(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        let [width, _] = self.size();
        let slope = |at: usize, center: f64, focal: f64| ((at as f64 + 0.5 - center) / focal) as f32;
        let rows = self.depth.chunks_exact(width.max(1)).enumerate();
        self.camera.iter().flat_map(move |camera| {
            let k = *camera.intrinsics();
            rows.clone().flat_map(move |(v, row)| {
                let y = slope(v, k.cy, k.fy);
                let point = move |(u, z): (usize, &f32)| [slope(u, k.cx, k.fx) * z, y * z, *z];
                row.iter().enumerate().map(point)
            })
        })
    }
}
