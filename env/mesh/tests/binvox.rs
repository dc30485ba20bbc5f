//! Binvox files: bits kept, files that lie, damage.
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{
    MeshError, VoxelFrame, VoxelGrid, VoxelOptions, load_binvox, parse_binvox, voxelize, write_binvox,
};
use nalgebra::Point3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shapes::torus;

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Files keep every bit.
    #[test]
    fn files_read_back(
        n in 1..20_usize,
        seed in any::<u64>(),
        density in 0.0..1.0_f64,
        origin in prop::array::uniform3(-1e3..1e3_f64),
        side in 1e-6..1e3_f64,
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let flags = (0..n * n * n).map(|_| rng.random::<f64>() < density).collect();
        let grid = VoxelGrid::new(VoxelFrame::new(n, origin.into(), side).unwrap(), flags).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grid.binvox");
        write_binvox(&path, &grid).unwrap();
        prop_assert_eq!(load_binvox(&path).unwrap(), grid);
        prop_assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}

fn file(header: &str, runs: &[u8]) -> Vec<u8> {
    [header.as_bytes(), runs].concat()
}

#[test]
fn y_runs_fastest_in_a_file() {
    let header = "#binvox 1\ndim 2 2 2\ntranslate -1 0.5 2e-1\nscale 4\ndata\n";
    // Voxels in the file's order: x0 z0 y0, x0 z0 y1, x0 z1 y0, ...; the second and the seventh are set.
    let grid = parse_binvox(&file(header, &[0, 1, 1, 1, 0, 4, 1, 1, 0, 1])).unwrap();
    let frame = grid.frame();
    assert_eq!((frame.origin(), frame.side()), (Point3::new(-1.0, 0.5, 0.2), 4.0));
    for at in (0..8).map(|i| [i >> 2, i >> 1 & 1, i & 1]) {
        assert_eq!(grid.flags()[frame.index(at)], at == [0, 1, 0] || at == [1, 0, 1]);
    }
    let bare = parse_binvox(&file("#binvox 2\r\ndim 1 1 1\r\ndata\n", &[7, 1])).unwrap();
    assert_eq!((bare.frame().origin(), bare.frame().side(), bare.count()), (Point3::origin(), 1.0, 1));
}

#[test]
fn files_that_lie_are_refused() {
    let dim = |dim: &str| format!("#binvox 1\ndim {dim}\ndata\n");
    let cases: [(Vec<u8>, &str); 17] = [
        (vec![], "does not begin"),
        (b"#binvox 3\n".to_vec(), "does not begin"),
        (b"#binvox 1\ndim 2 2 2\n".to_vec(), "no line \"data\""),
        (file("#binvox 1\ndata\n", &[]), "no line \"dim\""),
        (file(&dim("2 2"), &[0, 8]), "needs 3 numbers"),
        (file(&dim("2 2 -2"), &[0, 8]), "needs 3 numbers"),
        (file(&dim("2 2 4"), &[0, 16]), "only cubes"),
        (file(&dim("0 0 0"), &[]), "only cubes"),
        (file(&dim("4000000000 4000000000 4000000000"), &[0, 8]), "only cubes"),
        (file(&dim("2 2 2\ndim 2 2 2"), &[0, 8]), "does not belong"),
        (file(&dim("2 2 2\nscale 0"), &[0, 8]), "positive"),
        (file(&dim("2 2 2\ntranslate 1 inf 0"), &[0, 8]), "finite"),
        (file(&dim("2 2 2"), &[0, 7]), "do not fill"),
        (file(&dim("2 2 2"), &[0, 8, 1]), "do not fill"),
        (file(&dim("2 2 2"), &[0, 7, 1, 2]), "1 to 1 were expected"),
        (file(&dim("2 2 2"), &[0, 4, 0, 0, 0, 4]), "1 to 4 were expected"),
        (file(&dim("2 2 2"), &[0, 4, 2, 4]), "value 2"),
    ];
    for (bytes, complaint) in cases {
        let error = parse_binvox(&bytes).unwrap_err().to_string();
        assert!(error.contains(complaint), "{error} does not say {complaint:?}");
    }
    // A thousandth of the size in the header: refused before a gigabyte is allocated.
    let hollow = file(&dim("1024 1024 1024"), &[0, 255].repeat(4000));
    assert!(matches!(parse_binvox(&hollow).unwrap_err(), MeshError::Truncated { .. }));
    assert!(matches!(load_binvox(std::path::Path::new("/no/such.binvox")).unwrap_err(), MeshError::Io { .. }));
    let frame = VoxelFrame::new(1, Point3::origin(), 1.0).unwrap();
    let one = VoxelGrid::new(frame, vec![true]).unwrap();
    assert!(matches!(
        write_binvox(std::path::Path::new("/no/such/folder/a.binvox"), &one).unwrap_err(),
        MeshError::Write { .. }
    ));
    assert!(VoxelGrid::new(frame, vec![true; 2]).is_err());
}

/// Reads `count` damaged files; every grid that is read must agree with its header.
fn fuzz(count: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seed.binvox");
    let options = VoxelOptions { resolution: 12, ..VoxelOptions::default() };
    write_binvox(&path, &voxelize(&torus(0.06, 0.02, 12), &options).unwrap().0).unwrap();
    let seed = std::fs::read(path).unwrap();
    let hostile: [&[u8]; 8] = [b"-1", b"1e309", b"nan", b"1024", b"18446744073709551616", b"\n", b"\0\xff", b"data\n"];
    let mut read = 0;
    for i in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(i);
        let mut bytes = seed.clone();
        for _ in 0..rng.random_range(1..4) {
            // Headers are short and matter most: half of the damage is done there.
            let reach = if rng.random() { bytes.len().min(90) } else { bytes.len() };
            let at = rng.random_range(0..reach.max(1)).min(bytes.len());
            let to = (at + rng.random_range(0..6)).min(bytes.len());
            match rng.random_range(0..4) {
                0 => bytes.truncate(at.max(1)),
                1 => drop(bytes.splice(at..to, hostile[rng.random_range(0..hostile.len())].iter().copied())),
                2 => bytes[at..to].iter_mut().for_each(|b| *b = rng.random()),
                _ => bytes[at..to].iter_mut().for_each(|b| *b ^= 1 << rng.random_range(0..8)),
            }
        }
        if let Ok(grid) = parse_binvox(&bytes) {
            read += 1;
            assert_eq!(grid.flags().len(), grid.frame().resolution().pow(3));
            assert!(grid.flags().len() <= 255 * bytes.len() && grid.frame().voxel_size() > 0.0);
        }
    }
    assert!(read > count / 50 && read < count, "{read} of {count} were read: the damage is too much or too little");
}

#[test]
fn ten_thousand_mutated_files_cause_no_panic() {
    fuzz(10_000);
}

#[test]
#[ignore = "ten times as many; run by make test-all"]
fn a_hundred_thousand_mutated_files_cause_no_panic() {
    fuzz(100_000);
}
