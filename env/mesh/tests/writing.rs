//! Files on disk: modes, links and devices, for reading and writing.
#![cfg(unix)]
#![allow(clippy::unwrap_used)]

mod shapes;

use graspbox_mesh::{LoadOptions, MeshError, PartsParams, convex_parts, load, load_binvox, write_atomic, write_obj};
use nalgebra::Vector3;
use shapes::cuboid;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::Command;

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

/// Files were readable only by their owner, with any umask, because the temporary file is.
#[test]
fn new_files_have_the_mode_that_the_umask_leaves_and_old_ones_keep_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let plain = folder.path().join("plain");
    std::fs::write(&plain, b"x").unwrap();
    let path = folder.path().join("a.obj");
    write_obj(&path, &cuboid(Vector3::repeat(0.1))).unwrap();
    assert_eq!(mode(&path), mode(&plain));
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o640)).unwrap();
    write_obj(&path, &cuboid(Vector3::repeat(0.2))).unwrap();
    assert_eq!(mode(&path), 0o640);
}

#[test]
fn links_are_written_through() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("far")).unwrap();
    std::fs::write(at("far/file"), b"old").unwrap();
    symlink("far/file", at("link")).unwrap();
    symlink(at("link"), at("chain")).unwrap();
    symlink("far/new", at("dangling")).unwrap();
    write_atomic(&at("chain"), b"new").unwrap();
    write_atomic(&at("dangling"), b"made").unwrap();
    assert!(["link", "chain", "dangling"].iter().all(|name| at(name).is_symlink()));
    assert_eq!(std::fs::read(at("far/file")).unwrap(), b"new");
    assert_eq!(std::fs::read(at("far/new")).unwrap(), b"made");
    symlink("circle", at("circle")).unwrap();
    assert!(write_atomic(&at("circle"), b"x").unwrap_err().to_string().contains("links"));
}

/// Renaming a temporary file over a device replaced the device.
#[test]
fn devices_pipes_and_folders_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let device = folder.path().join("device");
    symlink("/dev/null", &device).unwrap();
    for path in [&pipe, &device] {
        let error = write_atomic(path, b"x").unwrap_err();
        assert!(matches!(error, MeshError::Write { .. }) && error.to_string().contains("regular file"), "{error}");
    }
    assert!(write_atomic(folder.path(), b"x").unwrap_err().to_string().contains("directory"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
}

/// A pipe without a writer, or a device without an end, was read for ever.
#[test]
fn devices_and_pipes_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    assert!(Command::new("mkfifo").args([at("a.stl"), at("a.binvox")]).status().unwrap().success());
    symlink("/dev/zero", at("b.stl")).unwrap();
    symlink("/dev/zero", at("b.binvox")).unwrap();
    for name in ["a.stl", "b.stl"] {
        let error = load(&at(name), &LoadOptions::default()).unwrap_err();
        assert!(matches!(error, MeshError::Io { .. }) && error.to_string().contains("regular file"), "{error}");
    }
    for name in ["a.binvox", "b.binvox"] {
        assert!(matches!(load_binvox(&at(name)).unwrap_err(), MeshError::Io { .. }));
    }
    std::fs::create_dir(at("folder.stl")).unwrap();
    assert!(load(&at("folder.stl"), &LoadOptions::default()).unwrap_err().to_string().contains("directory"));
}

/// As a cache entry, a device was read into memory until that ran out.
#[test]
fn a_device_in_the_cache_costs_only_the_cache() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, params) = (cuboid(Vector3::new(0.05, 0.08, 0.2)), PartsParams::default());
    let made = convex_parts(&mesh, &params, Some(folder.path())).unwrap();
    let entry = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
    std::fs::remove_file(&entry).unwrap();
    symlink("/dev/zero", &entry).unwrap();
    let again = convex_parts(&mesh, &params, Some(folder.path())).unwrap();
    assert!(!again.cached && again.parts == made.parts);
    assert!(entry.is_symlink());
}
