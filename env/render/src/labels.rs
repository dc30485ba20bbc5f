//! Labels of a segmentation, and colours of objects.

/// Label of background pixels.
pub const BACKGROUND: u8 = 0;
/// Label of the table, the ground below it, and walls.
pub const TABLE: u8 = 1;
/// Label of the object, or of the first of several: [`object_label`] has those of the others.
pub const OBJECT: u8 = 2;
/// Label of the hand's link 0, the base; link i has this plus i.
pub const FIRST_LINK: u8 = 3;

const OBJECT_COLORS: [[f32; 3]; 8] = [
    [0.86, 0.33, 0.24],
    [0.93, 0.62, 0.20],
    [0.95, 0.80, 0.30],
    [0.45, 0.66, 0.33],
    [0.74, 0.45, 0.66],
    [0.90, 0.50, 0.45],
    [0.60, 0.42, 0.30],
    [0.55, 0.50, 0.80],
];

/// Colour of an object, a function of its name.
#[must_use]
pub fn object_color(name: &str) -> [f32; 3] {
    // FNV-1a.
    let mix = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
    let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325, mix);
    OBJECT_COLORS[((hash >> 32) % OBJECT_COLORS.len() as u64) as usize]
}

/// Label of object `index` of a scene with a hand of `links` links: the first has [`OBJECT`], the others follow the links.
#[must_use]
pub fn object_label(index: usize, links: usize) -> u8 {
    match index {
        0 => OBJECT,
        _ => (usize::from(FIRST_LINK) + links + index - 1).min(usize::from(u8::MAX)) as u8,
    }
}

/// Label of the arm that carries a hand of `links` links, in scenes of at most `objects` objects: it follows all others.
#[must_use]
pub fn arm_label(links: usize, objects: usize) -> u8 {
    object_label(objects.max(1), links)
}

/// Index of the object with a label: the inverse of [`object_label`].
#[must_use]
pub fn object_index(label: u8, links: usize) -> usize {
    match label {
        OBJECT => 0,
        _ => (usize::from(label) + 1).saturating_sub(usize::from(FIRST_LINK) + links),
    }
}
