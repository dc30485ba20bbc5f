//! glTF scenes: nodes, modes, quantised positions, buffers beside the file, and what is refused.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{LoadOptions, MeshError, MeshFormat, TriMesh, load, parse};
use serde_json::{Value, json};
use shapes::glb;

/// A tetrahedron of volume 1/6: 48 bytes of positions, 12 indices of one byte.
fn bytes() -> Vec<u8> {
    let points: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let faces = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    points.iter().flat_map(|x| x.to_le_bytes()).chain(faces).collect()
}

/// Its document; the values of `with` replace those of the same name.
fn document(with: Value) -> Value {
    let mut document = json!({
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [{"byteLength": 60}],
    });
    document.as_object_mut().unwrap().extend(with.as_object().unwrap().clone());
    document
}

fn read(with: Value) -> Result<TriMesh, MeshError> {
    parse(&glb(&document(with).to_string(), &bytes()), MeshFormat::Gltf, &LoadOptions::default())
}

fn refused(with: Value, expected: &str) {
    let error = read(with).unwrap_err().to_string();
    assert!(error.contains(expected), "{error}");
}

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-9 * b.abs(), "{a}, not {b}");
}

/// A node's own transform comes first, then its parents'. Of several scenes the default one is read; a mesh that two nodes name is
/// there twice, and a mirror image still faces outward.
#[test]
fn nodes_place_meshes() {
    let nodes = json!([
        {"children": [1, 2], "translation": [0, 0, 10], "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0, 2.0_f64.sqrt(), 2.0_f64.sqrt()], "translation": [3, 0, 0]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
        {"mesh": 0, "translation": [100, 0, 0]},
    ]);
    let mesh = read(json!({"nodes": nodes, "scene": 1, "scenes": [{"nodes": [3]}, {"nodes": [0]}]})).unwrap();
    assert_eq!((mesh.vertices().len(), mesh.faces().len()), (8, 8));
    near(mesh.signed_volume(), 2.0 * 8.0 / 6.0);
    let bounds = mesh.aabb();
    // A quarter turn about z takes (x, y) to (-y, x): from (0..1, 0..1) to (-1..0, 0..1), then by 3, then doubled.
    assert!((bounds.max - nalgebra::Point3::new(6.0, 2.0, 12.0)).norm() < 1e-9, "{bounds:?}");
    assert!((bounds.min - nalgebra::Point3::new(-2.0, 0.0, 10.0)).norm() < 1e-9, "{bounds:?}");
    // Without scenes the roots count, without nodes every mesh.
    let all = json!([{"mesh": 0}, {"children": [0], "scale": [3, 3, 3]}]);
    near(read(json!({"nodes": all})).unwrap().signed_volume(), 27.0 / 6.0);
    near(read(json!({"nodes": []})).unwrap().signed_volume(), 1.0 / 6.0);
}

#[test]
fn every_kind_of_triangle_is_read() {
    let modes = |mode: u32, indices: &[u8]| {
        let mut bytes = bytes();
        bytes.truncate(48);
        bytes.extend(indices);
        let mut document = document(json!({}));
        document["meshes"][0]["primitives"][0]["mode"] = mode.into();
        document["accessors"][1]["count"] = indices.len().into();
        document["bufferViews"][1]["byteLength"] = indices.len().into();
        document["buffers"][0]["byteLength"] = bytes.len().into();
        parse(&glb(&document.to_string(), &bytes), MeshFormat::Gltf, &LoadOptions::default())
    };
    near(modes(5, &[0, 1, 3, 2, 0, 1]).unwrap().signed_volume(), 1.0 / 6.0);
    assert_eq!(modes(6, &[1, 2, 3, 0]).unwrap().faces(), [[0, 1, 2], [0, 2, 3]]);
    for points_and_lines in 0..4 {
        assert!(matches!(modes(points_and_lines, &[0, 1, 2]), Err(MeshError::Empty)));
    }
    assert!(modes(4, &[0, 1, 2, 3]).unwrap_err().to_string().contains("4 corners, mode 4"));
    assert!(modes(7, &[0, 1, 2]).is_err());
    // Without indices the vertices follow each other.
    let primitives = json!([{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}]);
    assert_eq!(read(json!({"meshes": primitives})).unwrap().faces(), [[0, 1, 2], [2, 1, 3]]);
}

/// Positions as normalised integers of one or two bytes, with a stride (KHR_mesh_quantization); a node scales them.
#[test]
fn quantised_positions_are_read() {
    for (component, normalized, expected) in
        [(5120, true, 1.0), (5120, false, 127.0), (5122, true, 1.0), (5121, true, 127.0 / 255.0)]
    {
        let width = if component == 5122 { 2 } else { 1 };
        let one: &[u8] = if width == 2 { &[0xff, 0x7f] } else { &[127] };
        let mut packed = vec![0; 4 * 8];
        (0..3).for_each(|axis| packed[8 * (axis + 1) + width * axis..][..width].copy_from_slice(one));
        packed.extend(&bytes()[48..]);
        let mut document = document(json!({"extensionsRequired": ["KHR_mesh_quantization"]}));
        document["accessors"][0]["componentType"] = component.into();
        document["accessors"][0]["normalized"] = normalized.into();
        document["bufferViews"] = json!([{"buffer": 0, "byteLength": 32, "byteStride": 8}, {"buffer": 0, "byteOffset": 32, "byteLength": 12}]);
        document["buffers"][0]["byteLength"] = 44.into();
        let mesh = parse(&glb(&document.to_string(), &packed), MeshFormat::Gltf, &LoadOptions::default()).unwrap();
        near(mesh.extent(), expected);
    }
}

/// Materials, textures, cameras, animations and other extensions may be damaged.
#[test]
fn what_is_no_triangle_is_not_read() {
    let rest = json!({"materials": 7, "textures": [{"source": 99}], "animations": [{}], "cameras": null, "extensionsUsed": ["NEW"]});
    near(read(rest).unwrap().signed_volume(), 1.0 / 6.0);
}

#[test]
fn buffers_lie_in_the_folder_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |uri: &str| {
        let path = folder.path().join("it.gltf");
        std::fs::write(&path, document(json!({"buffers": [{"byteLength": 60, "uri": uri}]})).to_string()).unwrap();
        load(&path, &LoadOptions::default())
    };
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    std::fs::write(folder.path().join("parts/a b.bin"), bytes()).unwrap();
    for uri in ["parts/a b.bin", "./parts/a%20b.bin"] {
        near(write(uri).unwrap().signed_volume(), 1.0 / 6.0);
    }
    assert!(write("parts/c.bin").unwrap_err().to_string().contains("parts/c.bin: No such file"));
    for uri in ["../a.bin", "/etc/passwd", "%2Fetc%2Fpasswd", "parts/../../a.bin", "https://example.org/a.bin"] {
        let error = write(uri).unwrap_err().to_string();
        assert!(error.contains("no file in its folder; export it as .glb"), "{error}");
    }
    assert!(write("data:;base64,@@@").unwrap_err().to_string().contains("not in base 64"));
    std::fs::write(folder.path().join("short.bin"), &bytes()[..59]).unwrap();
    assert!(matches!(write("short.bin").unwrap_err(), MeshError::Truncated { .. }));
    let small = LoadOptions { max_bytes: 2000, ..LoadOptions::default() };
    std::fs::write(folder.path().join("large.bin"), vec![0; 3000]).unwrap();
    write("large.bin").unwrap_err();
    let error = load(&folder.path().join("it.gltf"), &small).unwrap_err();
    assert!(matches!(error, MeshError::FileTooLarge { limit: 2000, .. }), "{error}");
}

#[test]
fn damaged_documents_are_refused() {
    refused(json!({"asset": {"version": "1.0"}, "nodes": {}}), "version 1.0, but only version 2 is read");
    refused(json!({"nodes": [{"mesh": 3}]}), "mesh 3, which does not exist");
    refused(json!({"nodes": [{"children": [0]}], "scenes": [{"nodes": [0]}]}), "node 0 has two parents");
    let twice = json!([{"children": [1, 1]}, {"mesh": 0}]);
    refused(json!({"nodes": twice, "scenes": [{"nodes": [0]}]}), "node 1 has two parents");
    let many = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}", "{},".repeat(1 << 20));
    let error = parse(many.as_bytes(), MeshFormat::Gltf, &LoadOptions::default()).unwrap_err();
    assert!(matches!(error, MeshError::TooMany { what: "JSON objects", .. }), "{error}");
    refused(json!({"scenes": [{"nodes": [9]}]}), "node 9, which does not exist");
    refused(json!({"scene": 2, "scenes": [{}]}), "scene 2, which does not exist");
    refused(json!({"buffers": []}), "buffer 0, which does not exist");
    refused(json!({"buffers": [{"byteLength": 6000}]}), "truncated");
    let views = |first: Value| json!({"bufferViews": [first, {"buffer": 0, "byteOffset": 48, "byteLength": 12}]});
    refused(views(json!({"buffer": 0, "byteLength": 47})), "larger than its bufferView");
    refused(views(json!({"buffer": 0, "byteLength": 48, "byteStride": 8})), "larger than its bufferView");
    refused(views(json!({"buffer": 0, "byteLength": 48, "byteOffset": u64::MAX})), "truncated");
    let accessors = |first: Value, second: Value| json!({"accessors": [first, second]});
    let points = json!({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"});
    let indices = json!({"bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR"});
    for (key, value, expected) in [
        ("count", json!(u64::MAX), "count"),
        ("count", json!(4_000_000_000_u32), "larger than its bufferView"),
        ("count", json!(3), "names vertex 3"),
        ("type", json!("VEC2"), "where VEC3 is expected"),
        ("componentType", json!(5130), "componentType 5130"),
        ("sparse", json!({}), "sparse"),
        ("byteOffset", json!(u64::MAX), "larger than its bufferView"),
    ] {
        let mut changed = points.clone();
        changed[key] = value;
        refused(accessors(changed, indices.clone()), expected);
    }
    let mut floats = indices.clone();
    floats["componentType"] = 5126.into();
    floats["count"] = 3.into();
    refused(accessors(points.clone(), floats), "no vertex indices");
    let many = LoadOptions { max_faces: 100, ..LoadOptions::default() };
    let nodes: Vec<Value> = (0..30).map(|_| json!({"mesh": 0})).collect();
    let file = glb(&document(json!({"nodes": nodes})).to_string(), &bytes());
    assert!(matches!(parse(&file, MeshFormat::Gltf, &many).unwrap_err(), MeshError::TooMany { .. }));
}

#[test]
fn compressed_meshes_are_refused_with_advice() {
    let draco = json!([{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "extensions": {"KHR_draco_mesh_compression": {}}}]}]);
    let bare = json!([{"componentType": 5126, "count": 4, "type": "VEC3"}, {"componentType": 5121, "count": 12, "type": "SCALAR"}]);
    refused(json!({"meshes": draco, "accessors": bare}), "export it again without compression");
    // With a copy that is not compressed, that one is read.
    near(read(json!({"meshes": draco})).unwrap().signed_volume(), 1.0 / 6.0);
    let packed = json!({"buffer": 0, "byteLength": 48, "extensions": {"EXT_meshopt_compression": {}}});
    refused(json!({"bufferViews": [packed, {"buffer": 0, "byteOffset": 48, "byteLength": 12}]}), "without compression");
}

#[test]
fn damaged_containers_are_refused() {
    let file = glb(&document(json!({})).to_string(), &bytes());
    let error = |bytes: &[u8]| parse(bytes, MeshFormat::Gltf, &LoadOptions::default()).unwrap_err();
    for length in [5, 12, 19, 30, file.len() - 1] {
        assert!(matches!(error(&file[..length]), MeshError::Truncated { .. }), "{length}");
    }
    let mut old = file.clone();
    old[4] = 1;
    assert!(error(&old).to_string().contains("version 1"));
    assert!(error(&[file.clone(), file.clone()].concat()).to_string().contains("bytes follow"));
    parse(&[file.as_slice(), b"\0\0\n"].concat(), MeshFormat::Gltf, &LoadOptions::default()).unwrap();
    assert!(matches!(error(b"<!DOCTYPE html><html></html>"), MeshError::WrongFormat { .. }));
    assert!(matches!(
        parse(&file, MeshFormat::Stl, &LoadOptions::default()).unwrap_err(),
        MeshError::WrongFormat { .. }
    ));
    assert!(error(b"{\"asset\": {\"version\": \"2.0\"}, ").to_string().contains("JSON: EOF"));
}
