//! Prepared objects on disk: the same bits from an empty, a filled and a damaged cache, and nothing is made twice.

#![allow(clippy::unwrap_used)]

use graspbox_gym::objects::{Objects, Prepared};
use graspbox_gym::source::Source;
use graspbox_mesh::write_stl;
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use graspbox_tests::scenes::procedural;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

fn objects(sources: &[Source], cache: Option<&Path>, hand: &str) -> Objects {
    let hand = Arc::new(graspbox_hand::assets::asset(hand).unwrap().read().unwrap());
    Objects::new(sources.to_vec(), hand, PhysicsConfig::default(), cache.map(Path::to_path_buf)).unwrap()
}

/// A procedural mug, and the file of a bowl.
fn sources(folder: &Path) -> Vec<Source> {
    let path = folder.join("bowl.stl");
    write_stl(&path, procedural(Family::Bowl, 1).mesh()).unwrap();
    let mug = Source::Procedural { name: "mug".into(), family: Family::Mug, seed: 0, scale: 1.0, mass: None };
    vec![mug, Source::File { name: "bowl".into(), path, scale: 1.0, mass: Some(0.2) }]
}

/// Every bit of what an episode reads of an object.
fn exact(objects: &Objects, prepared: &Prepared) -> String {
    let body = prepared.body();
    let scenes: Vec<_> = (0..prepared.probabilities().len())
        .map(|resting| {
            let (found, scene) = objects.scene(prepared, resting).unwrap();
            (found, *scene.world_from_object(), prepared.width(resting))
        })
        .collect();
    let probabilities: Vec<f64> = prepared.probabilities().collect();
    let meshes: Vec<_> = body.parts().iter().chain([body.mesh()]).map(|mesh| mesh.content_hash()).collect();
    format!("{} {meshes:?} {:?} {scenes:?} {probabilities:?}", body.name(), body.mass_properties())
}

fn all(objects: &Objects) -> Vec<String> {
    (0..objects.len()).map(|index| exact(objects, &objects.prepared(index).unwrap())).collect()
}

/// Entries of a cache folder and of that of poses at rest, and their bytes.
fn entries(cache: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let folders = [cache.to_path_buf(), cache.join("scenes")];
    let files = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap()).map(|file| file.unwrap().path());
    files.filter(|path| path.is_file()).map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[test]
fn prepared_objects_have_the_same_bits_from_any_cache() {
    let folder = tempfile::tempdir().unwrap();
    let (sources, cache) = (sources(folder.path()), folder.path().join("cache"));
    let wanted = all(&objects(&sources, None, "reflex"));
    assert_eq!(all(&objects(&sources, Some(&cache), "reflex")), wanted, "empty");
    let written = entries(&cache);
    let old = SystemTime::UNIX_EPOCH + Duration::from_secs(1000);
    written.keys().for_each(|path| fs::File::options().append(true).open(path).unwrap().set_modified(old).unwrap());
    assert_eq!(all(&objects(&sources, Some(&cache), "reflex")), wanted, "filled");
    assert_eq!(entries(&cache), written);
    assert!(written.keys().all(|path| fs::metadata(path).unwrap().modified().unwrap() == old), "it was not read");
    for spoil in [|bytes: &mut Vec<u8>| bytes.truncate(50), |bytes: &mut Vec<u8>| bytes[45] ^= 1] {
        for (path, bytes) in &written {
            let mut bytes = bytes.clone();
            spoil(&mut bytes);
            fs::write(path, bytes).unwrap();
        }
        assert_eq!(all(&objects(&sources, Some(&cache), "reflex")), wanted, "damaged");
        assert_eq!(entries(&cache), written, "they are made again");
    }
}

#[test]
fn what_is_ready_on_disk_is_not_read_until_it_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let (mut sources, cache) = (sources(folder.path()), folder.path().join("cache"));
    let ready = |objects: &Objects, index: usize| {
        objects.prepare(index, true).unwrap();
        let need = graspbox_gym::objects::Need { object: index, resting: None, model: false };
        // Whatever was prepared in this process is in memory.
        !objects.is_ready(&need)
    };
    for index in [0, 1] {
        assert!(!ready(&objects(&sources, Some(&cache), "reflex"), index), "it was prepared");
        assert!(ready(&objects(&sources, Some(&cache), "reflex"), index), "it was on disk");
        assert!(!ready(&objects(&sources, Some(&cache), "panda_gripper"), index), "another hand");
        assert!(!ready(&objects(&sources, None, "reflex"), index), "no cache");
    }
    let path = folder.path().join("bowl.stl");
    sources[1] = Source::File { name: "bowl".into(), path: path.clone(), scale: 1.0, mass: Some(0.3) };
    assert!(!ready(&objects(&sources, Some(&cache), "reflex"), 1), "another mass");
    write_stl(&path, procedural(Family::Bowl, 2).mesh()).unwrap();
    assert!(!ready(&objects(&sources, Some(&cache), "reflex"), 1), "another file of the same name");
    fs::remove_file(&path).unwrap();
    let error = objects(&sources, Some(&cache), "reflex").prepare(1, true).unwrap_err().to_string();
    assert!(error.contains("bowl.stl"), "{error}");
}
