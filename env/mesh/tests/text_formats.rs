//! Text files as other programs write them: several solids, materials, lines, colours, comments, numbers of every form.
#![allow(clippy::unwrap_used)]

use graspbox_mesh::{LoadOptions, MeshFormat, TriMesh, parse};

const CORNERS: [&str; 4] = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn read(text: impl AsRef<[u8]>, format: MeshFormat) -> TriMesh {
    parse(text.as_ref(), format, &LoadOptions::default()).unwrap()
}

fn refusal(text: impl AsRef<[u8]>, format: MeshFormat) -> String {
    parse(text.as_ref(), format, &LoadOptions::default()).unwrap_err().to_string()
}

/// A tetrahedron of volume 1/6; `normal` is that of every facet.
fn solid(name: &str, normal: &str) -> String {
    let facet = |face: [usize; 3]| {
        let corners: String = face.iter().map(|&v| format!("   vertex {}\n", CORNERS[v])).collect();
        format!(" facet normal {normal}\n  outer loop\n{corners}  endloop\n endfacet\n")
    };
    format!("solid {name}\n{}endsolid {name}\n", FACES.map(facet).concat())
}

/// All but the first were lost in silence.
#[test]
fn an_stl_file_may_hold_several_solids() {
    let moved = solid("head facet", "-nan(ind) 0 0").replace("vertex 0", "vertex 5").replace("vertex 1", "vertex 6");
    let text = format!("{}\n  exported by hand\n{}", solid("handle", "nan nan nan"), moved.to_uppercase());
    let mesh = read(text, MeshFormat::Stl);
    assert_eq!((mesh.vertices().len(), mesh.faces().len()), (8, 8));
    assert!((mesh.signed_volume() - 2.0 / 6.0).abs() < 1e-12);
}

#[test]
fn an_stl_error_names_its_line() {
    let whole = solid("it", "0 0 1");
    for (damage, expected) in [
        (("vertex 0 1 0", "vertex 0 nan 0"), "line 5: the coordinate nan is not finite"),
        (("vertex 0 1 0", "vertex 0 1"), "line 5: it has too few numbers"),
        (("vertex 0 1 0", "vertex 0 1 x"), "line 5: \"x\" is not the number"),
        (("   vertex 0 1 0\n", ""), "line 7: the facet has 2 corners"),
        (("  outer loop", "  inner loop"), "line 3: \"inner\" is no word"),
        ((" facet normal", " normal"), "line 2: \"normal\" is no word"),
        (("endsolid it\n", ""), "truncated"),
        ((" endfacet\n facet", " facet"), "the facet before has no end"),
    ] {
        let error = refusal(whole.replacen(damage.0, damage.1, 1), MeshFormat::Stl);
        assert!(error.contains(expected), "{error}");
    }
}

fn off() -> String {
    let faces = FACES.map(|[a, b, c]| format!("3 {a} {b} {c}\n")).concat();
    format!("OFF\n4 4 6\n{}\n{faces}", CORNERS.join("\n"))
}

fn ply(extra: &str, values: &str) -> String {
    let corners = CORNERS.map(|corner| format!("{corner}{values}\n")).concat();
    let faces = FACES.map(|[a, b, c]| format!("3 {a} {b} {c}\n")).concat();
    format!(
        "ply\nformat ascii 1.0\ncomment end_header follows\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\n{extra}element face 4\nproperty list uchar int vertex_indices\nend_header\n{corners}{faces}"
    )
}

/// What follows a first mesh was lost in silence. Another mesh is read; anything else is an error.
#[test]
fn what_follows_a_mesh_is_read_or_refused() {
    for (format, text) in [(MeshFormat::Off, off()), (MeshFormat::Ply, ply("", ""))] {
        let twice = read(format!("{text}\n{text}\n\n"), format);
        assert_eq!((twice.vertices().len(), twice.faces().len()), (8, 8));
        assert!((twice.signed_volume() - 2.0 / 6.0).abs() < 1e-12);
        let lines = text.lines().count();
        let error = refusal(format!("{text}\n3 0 1 2\n"), format);
        assert!(error.contains(&format!("line {}: \"3 0 1 2\" follows", lines + 2)), "{error}");
        // The line of a second mesh counts from the start of the file.
        let error = refusal(format!("{text}{}", text.replacen("1 0 0\n", "1 x 0\n", 1)), format);
        let line = 1 + lines + text.lines().position(|line| line == "1 0 0").unwrap();
        assert!(error.contains(&format!("line {line}: \"x\"")), "{error}");
        // A face of the first mesh cannot have corners of the second.
        let error = refusal(format!("{}{text}", text.replacen("3 0 2 1\n", "3 0 2 5\n", 1)), format);
        assert!(error.contains("vertex 5"), "{error}");
    }
}

/// A binary header that names too few faces; a short note is harmless, a second mesh is read.
#[test]
fn what_follows_a_binary_ply_is_read_or_refused() {
    let head = ply("", "").replace("ascii", "binary_little_endian");
    let mut bytes = head.as_bytes()[..head.find("end_header\n0").unwrap() + 11].to_vec();
    let corners: Vec<f32> = CORNERS.join(" ").split(' ').map(|word| word.parse().unwrap()).collect();
    bytes.extend(corners.iter().flat_map(|x| x.to_le_bytes()));
    for face in FACES {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|&v| (v as u32).to_le_bytes()));
    }
    assert_eq!(read(&bytes, MeshFormat::Ply).faces().len(), 4);
    assert_eq!(read([&bytes, b"made by hand".as_slice()].concat(), MeshFormat::Ply).faces().len(), 4);
    assert_eq!(read([bytes.as_slice(), &bytes].concat(), MeshFormat::Ply).faces().len(), 8);
    let at = head.find("face 4").unwrap() + 5;
    bytes[at] = b'3';
    assert!(refusal(bytes, MeshFormat::Ply).contains("13 bytes follow"));
}

#[test]
fn ply_numbers_have_every_form_and_unused_columns_any_value() {
    let extra = "property float nx\nproperty list uchar float quality\nproperty float w\n";
    let text = ply(extra, " nan 2 -nan(ind) 1.#QNAN inf");
    let mesh = read(text.replace("\n1 0 0", "\n+1 0. -.0").replace("\n0 1 0", "\n0e5 1.e0 .0"), MeshFormat::Ply);
    assert!((mesh.signed_volume() - 1.0 / 6.0).abs() < 1e-12);
    let small = ply("", "").replace('1', "1e-3").replace("3 0 1e-3", "3 0 1").replace("2 1e-3", "2 1");
    let small = small.replace("3 1e-3 ", "3 1 ").replace("1e-3.0", "1.0");
    assert!((read(small, MeshFormat::Ply).extent() - f64::from(1e-3_f32)).abs() < 1e-15);
    let lines = ply("", "").lines().position(|line| line == "0 1 0").unwrap() + 1;
    for (word, expected) in [("nan", "is not finite"), ("1e39", "is not finite"), ("up", "is not the number")] {
        let error = refusal(ply("", "").replace("\n0 1 0", &format!("\n0 {word} 0")), MeshFormat::Ply);
        assert!(error.contains(&format!("line {lines}: ")) && error.contains(expected), "{error}");
    }
    // A note in the header, which one exporter of Blender wrote.
    let note = ply("", "").replacen("comment ", "Created by ", 1);
    assert_eq!(read(note, MeshFormat::Ply), read(ply("", ""), MeshFormat::Ply));
    let list = ply("", "").replace("property float x", "property list uchar float x");
    assert!(parse(list.as_bytes(), MeshFormat::Ply, &LoadOptions::default()).is_err());
}

fn obj() -> String {
    let faces = FACES.map(|face| format!("f {} {} {}\n", face[0] + 1, face[1] + 1, face[2] + 1)).concat();
    CORNERS.map(|corner| format!("v {corner}\n")).concat() + &faces
}

#[test]
fn obj_files_are_read_for_their_faces_alone() {
    let expected = read(obj(), MeshFormat::Obj);
    assert_eq!((expected.vertices().len(), expected.faces().len()), (4, 4));
    let same = |text: &[u8]| assert_eq!(read(text, MeshFormat::Obj), expected, "{}", String::from_utf8_lossy(text));
    let start = |lines: &str| same((lines.to_owned() + &obj()).as_bytes());
    start("mtllib\nusemtl\nusemtl \ns off\ng\no\nvn nan 0 0\nvt\n");
    start("# C:\\meshes\\\n");
    same((obj() + "f 1 2\nf\nl 1 2 3\nl 1 2\np 4\ncurv 0 1 2\n").as_bytes());
    same(obj().replace("v 1 0 0", "v 1 0 0 # a corner \\").as_bytes());
    same(obj().replace("v 1 0 0", "v 1 0 0 1.0").replace("v 0 1 0", "\tv\t0 1 0 0.5 nan 255 ").as_bytes());
    same(obj().replace("f 1 3 2", "f 1/9/7 3//1 2/4#3").as_bytes());
    // Backwards from the vertices before the line; forwards over all of them; across groups and objects.
    same(obj().replace("f 2 3 4", "f -3 -2 -1").as_bytes());
    let (points, faces) = (&obj()[..obj().find('f').unwrap()], &obj()[obj().find('f').unwrap()..]);
    same(format!("{faces}{points}").as_bytes());
    same(format!("o a\n{points}g b\nusemtl c\n{}", faces.replace("f 1 2", "o d e\ng\nf 1 2")).as_bytes());
    // A name in Latin-1.
    same(&[b"o Tass\xe9\n".as_slice(), obj().as_bytes()].concat());
    // A vertex that no face uses is dropped.
    same((obj() + "v 7 7 7\n").as_bytes());
}

#[test]
fn an_obj_error_names_its_line() {
    for (damage, expected) in [
        (("v 1 0 0", "v 1 0"), "line 2: it has too few numbers"),
        (("f 1 3 2", "f 1 3 0"), "line 5: the face names vertex 0, which is none of the 4"),
        (("f 1 3 2", "f 1 3 5"), "line 5: the face names vertex 5"),
        (("f 1 3 2", "f 1 3 -5"), "line 5: the face names vertex -5"),
        (("f 1 3 2", "f 1 3 -9223372036854775808"), "line 5: the face names vertex"),
        (("f 1 3 2", "f 1 3 x"), "line 5: \"x\" is not the number"),
        (("f 1 3 2", "f 1 3 99999999999999999999"), "line 5: \"99999999999999999999\" is not the number"),
        (("f 1 3 2", "f 1 \\\n3 \\\n2\nf 1 2 x"), "line 8: \"x\""),
    ] {
        let error = refusal(obj().replacen(damage.0, damage.1, 1), MeshFormat::Obj);
        assert!(error.contains(expected), "{error}");
    }
}
