//! The ReFlex hand, embedded.

use std::sync::OnceLock;

use crate::error::HandError;
use crate::model::Hand;

/// Its URDF.
pub const REFLEX_URDF: &str = include_str!("../assets/reflex/reflex.urdf");
/// Its tendons, springs, motors and sensors.
pub const REFLEX_TOML: &str = include_str!("../assets/reflex/hand.toml");

impl Hand {
    /// The ReFlex: three fingers, each on one tendon, fingers 1 and 2 on a swivel. Parsed once.
    ///
    /// # Errors
    /// None for the files as they are embedded, which a test holds; a change of them that is not valid is reported as
    /// by [`Hand::from_strs`].
    pub fn reflex() -> Result<&'static Self, HandError> {
        static REFLEX: OnceLock<Hand> = OnceLock::new();
        if let Some(hand) = REFLEX.get() {
            return Ok(hand);
        }
        let hand = Self::from_strs(REFLEX_URDF, REFLEX_TOML, ["reflex.urdf", "hand.toml"])?;
        Ok(REFLEX.get_or_init(|| hand))
    }
}
