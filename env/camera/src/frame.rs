//! The images that a camera takes.

use crate::{Camera, Intrinsics};

/// Images of one camera, row by row from the upper left pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    pub(crate) camera: Option<Camera>,
    /// (H, W): metres along the optical axis (not along the ray); 0 where nothing was seen.
    pub depth: Vec<f32>,
    /// (H, W, 3): red, green, blue; empty unless asked for.
    pub rgb: Vec<u8>,
    /// (H, W): the label of the instance seen; 0 for background; empty unless asked for.
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

    /// Depth of the pixel that contains image position (`u`, `v`); `None` outside the image and where nothing was seen.
    #[must_use]
    pub fn depth_at(&self, u: f64, v: f64) -> Option<f32> {
        let [width, height] = self.size();
        let inside = u >= 0.0 && v >= 0.0 && u < width as f64 && v < height as f64;
        let z = inside.then(|| self.depth[v as usize * width + u as usize])?;
        (z > 0.0).then_some(z)
    }

    /// (H, W): depth in millimetres, rounded; 0 where nothing was seen or the depth exceeds 65.535 m.
    pub fn depth_millimetres(&self) -> impl Iterator<Item = u16> + '_ {
        self.depth.iter().map(|z| {
            let mm = z * 1000.0 + 0.5;
            if mm < 65_536.0 { mm as u16 } else { 0 }
        })
    }

    /// (H, W, 3): the point seen by each pixel in the camera's frame, metres; zeros where nothing was seen.
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
