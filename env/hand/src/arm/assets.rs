//! The arms that come with the project, embedded: their two files by name.

use super::Arm;
use crate::error::HandError;

/// An arm that comes with the project.
#[derive(Clone, Copy, Debug)]
pub struct ArmAsset {
    /// Name, as in its `arm.toml`.
    pub name: &'static str,
    pub urdf: &'static str,
    /// Its `arm.toml`.
    pub toml: &'static str,
}

/// The files of an arm, by its name.
macro_rules! asset {
    ($name:literal) => {
        ArmAsset {
            name: $name,
            urdf: include_str!(concat!("../../arms/", $name, "/", $name, ".urdf")),
            toml: include_str!(concat!("../../arms/", $name, "/arm.toml")),
        }
    };
}

/// The arms that come with the project.
pub const ARMS: [ArmAsset; 4] = [asset!("fr3"), asset!("ur5e"), asset!("xarm7"), asset!("so101")];

/// The arm of a name.
///
/// # Errors
/// [`HandError::UnknownArm`] for any other name, with those that exist.
pub fn arm_asset(name: &str) -> Result<&'static ArmAsset, HandError> {
    let found = ARMS.iter().find(|asset| asset.name == name);
    found.ok_or_else(|| HandError::UnknownArm { name: name.to_owned(), known: ARMS.map(|asset| asset.name).join(", ") })
}

impl ArmAsset {
    /// The arm of these files.
    ///
    /// # Errors
    /// None for the embedded files, which a test checks; an invalid change of them is reported as by [`Arm::from_strs`].
    pub fn read(&self) -> Result<Arm, HandError> {
        Arm::from_strs(self.urdf, self.toml, [&format!("{}.urdf", self.name), "arm.toml"])
    }
}
