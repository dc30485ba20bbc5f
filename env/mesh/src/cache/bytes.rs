//! Meshes as bytes: little-endian, every coordinate with its bits.

use crate::trimesh::TriMesh;
use nalgebra::Point3;

/// Appends a number.
pub fn put_f64(body: &mut Vec<u8>, x: f64) {
    body.extend(x.to_bits().to_le_bytes());
}

/// Appends a count.
pub fn put_u32(body: &mut Vec<u8>, n: usize) {
    body.extend((n as u32).to_le_bytes());
}

/// Appends a mesh.
pub fn put_mesh(body: &mut Vec<u8>, mesh: &TriMesh) {
    put_u32(body, mesh.vertices().len());
    put_u32(body, mesh.faces().len());
    mesh.vertices().iter().flat_map(|p| p.coords.iter()).for_each(|x| put_f64(body, *x));
    body.extend(mesh.faces().iter().flatten().flat_map(|v| v.to_le_bytes()));
}

/// Reads from the front, in the order of the writer.
pub struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    /// The next count.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// The next number.
    pub fn f64(&mut self) -> Option<f64> {
        self.take().map(|b| f64::from_bits(u64::from_le_bytes(b)))
    }

    /// The next mesh.
    pub fn mesh(&mut self) -> Option<TriMesh> {
        let (vertices, faces) = (self.u32()?, self.u32()?);
        // Collected one by one: with a false count the bytes end before memory does.
        let vertices: Option<Vec<_>> =
            (0..vertices).map(|_| Some(Point3::new(self.f64()?, self.f64()?, self.f64()?))).collect();
        let faces: Option<Vec<_>> = (0..faces).map(|_| Some([self.u32()?, self.u32()?, self.u32()?])).collect();
        TriMesh::new(vertices?, faces?).ok()
    }

    /// `found`, if nothing is left.
    pub fn end<T>(self, found: T) -> Option<T> {
        self.0.is_empty().then_some(found)
    }
}
