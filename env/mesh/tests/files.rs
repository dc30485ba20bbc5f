//! Mesh files: round trips, clear refusals, and mutated files that must neither crash nor allocate without bound.
#![allow(clippy::unwrap_used)]

mod shapes;

use base64::Engine;
use graspbox_mesh::{LoadOptions, MeshError, MeshFormat, TriMesh, load, parse, write_obj, write_stl};
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shapes::{cuboid, glb, torus};
use std::fmt::Write;

fn ply_header(format: &str, vertices: u64, faces: u64) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made for a test\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn ply_ascii(mesh: &TriMesh) -> Vec<u8> {
    let mut text = ply_header("ascii", mesh.vertices().len() as u64, mesh.faces().len() as u64);
    mesh.vertices().iter().for_each(|p| writeln!(text, "{} {} {} 200", p.x as f32, p.y as f32, p.z as f32).unwrap());
    mesh.faces().iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    text.into_bytes()
}

fn ply_binary(mesh: &TriMesh, big: bool) -> Vec<u8> {
    let name = if big { "binary_big_endian" } else { "binary_little_endian" };
    let mut bytes = ply_header(name, mesh.vertices().len() as u64, mesh.faces().len() as u64).into_bytes();
    let word = |x: u32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
    for p in mesh.vertices() {
        p.coords.iter().for_each(|x| bytes.extend(word((*x as f32).to_bits())));
        bytes.push(200);
    }
    for f in mesh.faces() {
        bytes.push(3);
        f.iter().for_each(|&v| bytes.extend(word(v)));
    }
    bytes
}

fn off(mesh: &TriMesh) -> Vec<u8> {
    let mut text = format!("OFF # a comment\n{} {} 0\n\n", mesh.vertices().len(), mesh.faces().len());
    mesh.vertices().iter().for_each(|p| writeln!(text, "{} {} {}", p.x, p.y, p.z).unwrap());
    mesh.faces().iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c} 255 0 0").unwrap());
    text.into_bytes()
}

fn stl_ascii(mesh: &TriMesh) -> Vec<u8> {
    let mut text = String::from("solid\n");
    for f in 0..mesh.faces().len() {
        text.push_str("  facet normal 0 0 1\n    outer loop\n");
        mesh.triangle(f).iter().for_each(|p| writeln!(text, "      vertex {} {} {:E}", p.x, p.y, p.z).unwrap());
        text.push_str("    endloop\n  endfacet\n");
    }
    text.push_str("endsolid\n");
    text.into_bytes()
}

fn written(mesh: &TriMesh, name: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    if name.ends_with("stl") {
        write_stl(&path, mesh).unwrap()
    } else {
        write_obj(&path, mesh).unwrap()
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    std::fs::read(path).unwrap()
}

/// A glTF document of one mesh; `buffer` says where its bytes are.
fn gltf_json(mesh: &TriMesh, buffer: &str) -> String {
    let (vertices, corners) = (mesh.vertices().len(), 3 * mesh.faces().len());
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}},\"indices\":1}}]}}],\"accessors\":[{{\"bufferView\":0,\
         \"componentType\":5126,\"count\":{vertices},\"type\":\"VEC3\"}},{{\"bufferView\":1,\"componentType\":5125,\"count\":{corners},\
         \"type\":\"SCALAR\"}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":{points}}},{{\"buffer\":0,\"byteOffset\":{points},\
         \"byteLength\":{indices}}}],\"buffers\":[{{\"byteLength\":{total}{buffer}}}]}}",
        points = 12 * vertices,
        indices = 4 * corners,
        total = 12 * vertices + 4 * corners
    )
}

fn gltf_bytes(mesh: &TriMesh) -> Vec<u8> {
    let points = mesh.vertices().iter().flat_map(|p| [p.x, p.y, p.z]).flat_map(|x| (x as f32).to_le_bytes());
    points.chain(mesh.faces().iter().flatten().flat_map(|v| v.to_le_bytes())).collect()
}

fn gltf(mesh: &TriMesh) -> Vec<u8> {
    let data = base64::engine::general_purpose::STANDARD.encode(gltf_bytes(mesh));
    gltf_json(mesh, &format!(",\"uri\":\"data:application/octet-stream;base64,{data}\"")).into_bytes()
}

/// The same mesh in every format.
fn files(mesh: &TriMesh) -> Vec<(MeshFormat, Vec<u8>)> {
    vec![
        (MeshFormat::Stl, written(mesh, "a.stl")),
        (MeshFormat::Stl, stl_ascii(mesh)),
        (MeshFormat::Ply, ply_ascii(mesh)),
        (MeshFormat::Ply, ply_binary(mesh, false)),
        (MeshFormat::Ply, ply_binary(mesh, true)),
        (MeshFormat::Obj, written(mesh, "a.obj")),
        (MeshFormat::Off, off(mesh)),
        (MeshFormat::Gltf, glb(&gltf_json(mesh, ""), &gltf_bytes(mesh))),
        (MeshFormat::Gltf, gltf(mesh)),
    ]
}

#[test]
fn every_format_reads_back() {
    let mesh = torus(0.06, 0.02, 12);
    for (format, bytes) in files(&mesh) {
        let read = parse(&bytes, format, &LoadOptions::default()).unwrap();
        assert_eq!(read.faces().len(), mesh.faces().len());
        for f in 0..mesh.faces().len() {
            let pairs = read.triangle(f).into_iter().zip(mesh.triangle(f));
            pairs.for_each(|(p, q)| assert!((p - q).norm() < 1e-8, "{format:?}"));
        }
        let millimeters = LoadOptions { scale: 1e-3, ..LoadOptions::default() };
        let small = parse(&bytes, format, &millimeters).unwrap();
        assert!((small.extent() - read.extent() * 1e-3).abs() < 1e-12);
    }
    // An OBJ keeps every bit, though its vertices come back in the order of their first use.
    let read = parse(&written(&mesh, "a.obj"), MeshFormat::Obj, &LoadOptions::default()).unwrap();
    assert!((0..mesh.faces().len()).all(|f| read.triangle(f) == mesh.triangle(f)));
}

#[test]
fn a_binary_stl_may_begin_with_solid() {
    let mut bytes = written(&cuboid(Vector3::new(0.1, 0.1, 0.1)), "a.stl");
    bytes[..14].copy_from_slice(b"solid is a lie");
    assert_eq!(parse(&bytes, MeshFormat::Stl, &LoadOptions::default()).unwrap().faces().len(), 12);
}

#[test]
fn polygons_become_fans() {
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1/1/1 2 3 4\nf -1 -2 -3\n";
    let mesh = parse(obj.replace("/1/1", "").as_bytes(), MeshFormat::Obj, &LoadOptions::default()).unwrap();
    assert_eq!(mesh.faces(), [[0, 1, 2], [0, 2, 3], [4, 3, 2]]);
    let off = "OFF4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    assert_eq!(parse(off.as_bytes(), MeshFormat::Off, &LoadOptions::default()).unwrap().faces().len(), 2);
}

fn refusal(bytes: &[u8], format: MeshFormat) -> MeshError {
    parse(bytes, format, &LoadOptions::default()).unwrap_err()
}

#[test]
fn headers_that_lie_are_refused_before_anything_is_allocated() {
    let mut stl = vec![0_u8; 134];
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(refusal(&stl, MeshFormat::Stl), MeshError::TooMany { .. }));
    stl[80..84].copy_from_slice(&1000_u32.to_le_bytes());
    assert!(matches!(refusal(&stl, MeshFormat::Stl), MeshError::Truncated { .. }));
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let many = ply_header(format, 1_000_000_000_000, 1);
        assert!(matches!(refusal(many.as_bytes(), MeshFormat::Ply), MeshError::TooMany { .. }));
        let truncated = ply_header(format, 1_000_000, 1_000_000);
        assert!(matches!(refusal(truncated.as_bytes(), MeshFormat::Ply), MeshError::Truncated { .. }));
    }
    let endless =
        "ply\nformat ascii 1.0\nelement ghost 1000000000000\nelement vertex 1\nproperty float x\nend_header\n";
    assert!(matches!(refusal(endless.as_bytes(), MeshFormat::Ply), MeshError::Malformed { .. }));
    assert!(matches!(refusal(b"OFF\n4000000000 1 0\n", MeshFormat::Off), MeshError::TooMany { .. }));
    assert!(matches!(refusal(b"OFF\n3000000 1 0\n", MeshFormat::Off), MeshError::Truncated { .. }));
    let tight = LoadOptions { max_faces: 11, ..LoadOptions::default() };
    for (format, bytes) in files(&cuboid(Vector3::new(0.1, 0.1, 0.1))) {
        assert!(matches!(parse(&bytes, format, &tight).unwrap_err(), MeshError::TooMany { .. }), "{format:?}");
        let small = LoadOptions { max_bytes: 50, ..LoadOptions::default() };
        assert!(matches!(parse(&bytes, format, &small).unwrap_err(), MeshError::FileTooLarge { .. }));
    }
}

/// A header that names one triangle fewer would lose a part of the surface in silence; a short note at the end is harmless.
#[test]
fn an_stl_header_that_names_too_few_triangles_is_refused() {
    let mut stl = written(&cuboid(Vector3::new(0.1, 0.1, 0.1)), "a.stl");
    stl.extend(b"made by hand");
    assert_eq!(parse(&stl, MeshFormat::Stl, &LoadOptions::default()).unwrap().faces().len(), 12);
    stl[80..84].copy_from_slice(&11_u32.to_le_bytes());
    let error = refusal(&stl, MeshFormat::Stl).to_string();
    assert!(error.contains("62 bytes follow the 11 triangles"), "{error}");
}

/// A web page saved as .stl "named 1768453152 triangles".
#[test]
fn a_wrong_ending_is_named() {
    let mesh = cuboid(Vector3::new(0.1, 0.1, 0.1));
    let page =
        b"<!DOCTYPE html>\n<html><head><title>Not found, try again later please</title></head><body>gone</body></html>";
    let text =
        b"Dear user, this model has moved to another address. Please ask for it there, and do so politely, thanks.";
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n";
    let cases: [(&[u8], MeshFormat, &str); 9] = [
        (page, MeshFormat::Stl, "web page"),
        (page, MeshFormat::Ply, "web page"),
        (text, MeshFormat::Stl, "plain text"),
        (pointer, MeshFormat::Stl, "git lfs pull"),
        (&ply_binary(&mesh, false), MeshFormat::Stl, "a PLY file"),
        (&ply_ascii(&mesh), MeshFormat::Obj, "a PLY file"),
        (&off(&mesh), MeshFormat::Ply, "an OFF file"),
        (&written(&mesh, "a.obj"), MeshFormat::Stl, "an OBJ file"),
        (&stl_ascii(&mesh), MeshFormat::Ply, "an ASCII STL file"),
    ];
    for (bytes, format, found) in cases {
        let error = refusal(bytes, format);
        assert!(matches!(error, MeshError::WrongFormat { .. }), "{error}");
        assert!(error.to_string().contains(found) && error.to_string().contains(format.name()), "{error}");
    }
    // A truncated file of the right format is not blamed on its ending.
    let ascii = stl_ascii(&mesh);
    let cut = refusal(&ascii[..ascii.len() / 2], MeshFormat::Stl);
    assert!(!matches!(cut, MeshError::WrongFormat { .. }), "{cut}");
}

/// A long face may continue on the next line; the parser took the backslash for a corner. A comment that ends in one (a Windows path)
/// does not hide the line after it.
#[test]
fn obj_lines_continue_after_a_backslash() {
    let plain = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\n";
    let expected = parse(plain.as_bytes(), MeshFormat::Obj, &LoadOptions::default()).unwrap();
    let cut = plain.replace("v 1 1", "v 1 \\\n  1").replace("f 1 2 3 4", "f 1 \\\n2 \\ \n3\\\r\n 4");
    for text in [
        cut.clone(),
        cut.replace('\n', "\r\n").replace("\r\r", "\r"),
        format!("# C:\\meshes\\\n{plain}"),
        format!("{plain}\\"),
    ] {
        assert_eq!(parse(text.as_bytes(), MeshFormat::Obj, &LoadOptions::default()).unwrap(), expected, "{text:?}");
    }
}

/// A byte-order mark hid the first vertex of an OBJ ("index out of bounds").
#[test]
fn a_byte_order_mark_is_skipped() {
    let mesh = cuboid(Vector3::new(0.1, 0.1, 0.1));
    for (format, bytes) in
        [(MeshFormat::Obj, written(&mesh, "a.obj")), (MeshFormat::Off, off(&mesh)), (MeshFormat::Ply, ply_ascii(&mesh))]
    {
        let marked = [b"\xef\xbb\xbf".as_slice(), &bytes].concat();
        let read = |bytes: &[u8]| parse(bytes, format, &LoadOptions::default()).unwrap();
        assert_eq!(read(&marked), read(&bytes));
    }
}

#[test]
fn every_refusal_says_what_to_do() {
    for format in [MeshFormat::Stl, MeshFormat::Ply, MeshFormat::Obj, MeshFormat::Off, MeshFormat::Gltf] {
        assert!(parse(b"", format, &LoadOptions::default()).is_err());
        assert!(parse(b"hello, this is no mesh\n", format, &LoadOptions::default()).is_err());
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let options = LoadOptions { scale, ..LoadOptions::default() };
            assert!(matches!(parse(b"x", format, &options).unwrap_err(), MeshError::BadScale { .. }));
        }
    }
    let obj = |size: &str| format!("v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf 1 2 3\n");
    let far = refusal(obj("2000").as_bytes(), MeshFormat::Obj);
    assert!(matches!(far, MeshError::TooFar { .. }) && far.to_string().contains("scale="));
    let tiny = refusal(obj("1e-9").as_bytes(), MeshFormat::Obj);
    assert!(matches!(tiny, MeshError::TooSmall { .. }) && tiny.to_string().contains("scale="));
    let nan = refusal(b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", MeshFormat::Obj).to_string();
    assert!(nan.contains("line 3: the coordinate nan is not finite"), "{nan}");
    assert!(matches!(
        refusal(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", MeshFormat::Off),
        MeshError::BadIndex { .. }
    ));
    // A face of two corners is an edge.
    assert!(matches!(refusal(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", MeshFormat::Off), MeshError::Empty));
    assert!(matches!(refusal(b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", MeshFormat::Off), MeshError::Empty));
    let unknown = load(std::path::Path::new("mesh.step"), &LoadOptions::default()).unwrap_err();
    assert!(unknown.to_string().contains(".stl, .ply, .obj, .off, .glb, .gltf; convert it"));
}

/// One damage: a byte, a run, a cut, a doubled stretch, or a number replaced by a hostile one.
fn mutate(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let hostile: [&[u8]; 10] = [
        b"-1",
        b"1e309",
        b"nan",
        b"4294967295",
        b"18446744073709551616",
        b"0",
        b"\0\0\0",
        b"\xff\xff\xff\xff",
        b"\n",
        b" ",
    ];
    if bytes.is_empty() {
        return;
    }
    let at = rng.random_range(0..bytes.len());
    match rng.random_range(0..6) {
        0 => bytes[at] = rng.random(),
        1 => bytes[at] ^= 1 << rng.random_range(0..8),
        2 => bytes.truncate(at),
        3 => {
            let to = (at + rng.random_range(1..40)).min(bytes.len());
            bytes.drain(at..to);
        }
        4 => {
            let to = (at + rng.random_range(1..200)).min(bytes.len());
            let copy = bytes[at..to].to_vec();
            bytes.splice(at..at, copy);
        }
        _ => {
            let to = (at + rng.random_range(1..8)).min(bytes.len());
            bytes.splice(at..to, hostile[rng.random_range(0..hostile.len())].iter().copied());
        }
    }
}

/// Reads `count` mutated files; a panic would fail the test, and every mesh that is read must be within its limits and valid.
fn fuzz(count: u64) {
    let seeds = files(&torus(0.06, 0.02, 4));
    let options = LoadOptions { max_bytes: 20_000, max_vertices: 200, max_faces: 200, ..LoadOptions::default() };
    let mut read = 0;
    for i in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(i);
        let (format, seed) = &seeds[i as usize % seeds.len()];
        let mut bytes = seed.clone();
        // Headers are short and matter most: half of the damage is done there.
        let tail = if rng.random() { bytes.split_off(bytes.len().min(250)) } else { Vec::new() };
        (0..rng.random_range(1..5)).for_each(|_| mutate(&mut bytes, &mut rng));
        bytes.extend(tail);
        match parse(&bytes, *format, &options) {
            Ok(mesh) => {
                read += 1;
                assert!(mesh.vertices().len() <= 200 && !mesh.faces().is_empty() && mesh.faces().len() <= 200);
                assert!(mesh.faces().iter().flatten().all(|&v| (v as usize) < mesh.vertices().len()));
                assert!(mesh.vertices().iter().all(|p: &Point3<f64>| p.coords.amax() <= 1e3));
            }
            // What a caught panic is turned into.
            Err(error) => assert!(!error.to_string().contains("gave up"), "{format:?}, seed {i}: {error}"),
        }
    }
    assert!(read > count / 50 && read < count, "{read} of {count} were read: the damage is too much or too little");
}

#[test]
fn three_thousand_mutated_files_cause_no_panic() {
    fuzz(3_000);
}

#[test]
#[ignore = "a minute; run by make test-all"]
fn a_hundred_thousand_mutated_files_cause_no_panic() {
    fuzz(100_000);
}
