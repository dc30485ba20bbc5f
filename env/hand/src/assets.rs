//! The hands that come with the project, embedded: their two files by name.

use std::sync::OnceLock;

use crate::error::HandError;
use crate::model::Hand;

/// A hand that comes with the project.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Name, as in its `hand.toml`.
    pub name: &'static str,
    pub urdf: &'static str,
    /// Its `hand.toml`.
    pub toml: &'static str,
}

/// The hands that come with the project; the first is the default.
pub const ASSETS: [Asset; 6] = [
    Asset {
        name: "reflex",
        urdf: include_str!("../assets/reflex/reflex.urdf"),
        toml: include_str!("../assets/reflex/hand.toml"),
    },
    Asset {
        name: "panda_gripper",
        urdf: include_str!("../assets/panda_gripper/panda_gripper.urdf"),
        toml: include_str!("../assets/panda_gripper/hand.toml"),
    },
    Asset {
        name: "soft_hand",
        urdf: include_str!("../assets/soft_hand/soft_hand.urdf"),
        toml: include_str!("../assets/soft_hand/hand.toml"),
    },
    Asset {
        name: "robotiq_2f_85",
        urdf: include_str!("../assets/robotiq_2f_85/robotiq_2f_85.urdf"),
        toml: include_str!("../assets/robotiq_2f_85/hand.toml"),
    },
    Asset {
        name: "leap",
        urdf: include_str!("../assets/leap/leap.urdf"),
        toml: include_str!("../assets/leap/hand.toml"),
    },
    Asset {
        name: "inspire",
        urdf: include_str!("../assets/inspire/inspire.urdf"),
        toml: include_str!("../assets/inspire/hand.toml"),
    },
];

/// The asset of a name.
///
/// # Errors
/// [`HandError::UnknownName`] for any other name, with those that exist.
pub fn asset(name: &str) -> Result<&'static Asset, HandError> {
    let found = ASSETS.iter().find(|asset| asset.name == name);
    found.ok_or_else(|| HandError::UnknownName {
        name: name.to_owned(),
        known: ASSETS.map(|asset| asset.name).join(", "),
    })
}

impl Asset {
    /// The hand of these files.
    ///
    /// # Errors
    /// None for the embedded files, which a test checks; an invalid change of them is reported as
    /// by [`Hand::from_strs`].
    pub fn read(&self) -> Result<Hand, HandError> {
        Hand::from_strs(self.urdf, self.toml, [&format!("{}.urdf", self.name), "hand.toml"])
    }
}

impl Hand {
    /// The ReFlex: three fingers, each on one tendon, fingers 1 and 2 on a swivel. Parsed once.
    ///
    /// # Errors
    /// As [`Asset::read`].
    pub fn reflex() -> Result<&'static Self, HandError> {
        static REFLEX: OnceLock<Hand> = OnceLock::new();
        if let Some(hand) = REFLEX.get() {
            return Ok(hand);
        }
        let hand = ASSETS[0].read()?;
        Ok(REFLEX.get_or_init(|| hand))
    }
}
