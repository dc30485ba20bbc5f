//! Normals for shading: smooth over curved surfaces, sharp at creases.

use graspbox_mesh::TriMesh;
use nalgebra::Vector3;

/// Cosine of the crease angle (52 degrees): faces that meet at a smaller angle, such as a chamfer's 45 degrees, are shaded as one surface.
const CREASE_COSINE: f64 = 0.616;

/// Unit normals, and for each face the indices of its corners' normals.
///
/// A corner's normal is the sum of the area vectors of the faces at its vertex that are smooth with its face.
pub(crate) fn corner_normals(mesh: &TriMesh) -> (Vec<Vector3<f32>>, Vec<[u32; 3]>) {
    let areas: Vec<Vector3<f64>> = (0..mesh.faces().len()).map(|f| mesh.face_area_vector(f)).collect();
    let units: Vec<_> = areas.iter().map(|a| a.try_normalize(0.0).unwrap_or_default()).collect();
    let mut around = vec![Vec::new(); mesh.vertices().len()];
    for (f, face) in mesh.faces().iter().enumerate() {
        for (k, &v) in face.iter().enumerate() {
            around[v as usize].push((f, k));
        }
    }
    let (mut normals, mut corners) = (Vec::new(), vec![[0; 3]; areas.len()]);
    for corners_here in &around {
        let first = normals.len();
        for &(f, k) in corners_here {
            let smooth = corners_here.iter().filter(|(g, _)| units[f].dot(&units[*g]) >= CREASE_COSINE);
            let sum: Vector3<f64> = smooth.map(|(g, _)| areas[*g]).sum();
            let normal: Vector3<f32> = sum.try_normalize(0.0).unwrap_or(units[f]).cast();
            let known = normals[first..].iter().position(|n| *n == normal);
            corners[f][k] = (first + known.unwrap_or(normals.len() - first)) as u32;
            if known.is_none() {
                normals.push(normal);
            }
        }
    }
    (normals, corners)
}
