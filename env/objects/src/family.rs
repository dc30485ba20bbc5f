//! The families: their names, and their ranges of size and mass.

use std::fmt;
use std::str::FromStr;

/// A kind of household object with free parameters.
///
/// The numbers are part of the seed and never change, so `(family, seed)` always denotes the same object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Family {
    /// Grocery box, upright or lying.
    Box = 0,
    /// Wooden toy block.
    WoodBlock = 1,
    /// Full food can.
    Can = 2,
    /// Full bottle or jar, round, oval or squarish.
    Bottle = 3,
    /// Table tennis, golf, tennis, base- or softball.
    Ball = 4,
    /// Superquadric solid.
    Superquadric = 5,
    /// Tumbler, drinking glass or stacking cup.
    Cup = 6,
    /// Bowl on a low foot.
    Bowl = 7,
    /// Plate with a raised rim.
    Plate = 8,
    /// Stemmed glass.
    WineGlass = 9,
    /// Mug with a handle.
    Mug = 10,
    /// Apple, orange, lemon, pear or peach.
    Fruit = 11,
    /// Banana, lying.
    Banana = 12,
    /// Cross-peen hammer, lying.
    Hammer = 13,
    /// Screwdriver, lying.
    Screwdriver = 14,
    /// Household scissors, a little open, lying.
    Scissors = 15,
    /// Table fork, lying.
    Fork = 16,
    /// Table or serving spoon, lying.
    Spoon = 17,
    /// C-clamp, lying.
    Clamp = 18,
    /// Straight chain of fused links.
    Chain = 19,
    /// Ring of round section, lying flat.
    Ring = 20,
    /// Kettle with spout and arched handle.
    Kettle = 21,
    /// Solid prism, standing or lying: die, domino, peg, puck, timber.
    Prism = 22,
    /// Bars or rods joined in a plane, lying: angle bracket, hook, fork of a frame, hex key.
    Bracket = 23,
    /// Filled carton or canister, standing or lying, or a thick piece of timber.
    Carton = 24,
}

/// Bounds that every object of a family keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FamilyFacts {
    pub family: Family,
    /// Its name in object sets, snake_case.
    pub name: &'static str,
    /// Least extents of the bounding box in the object frame (x, y, z), metres.
    pub least: [f64; 3],
    /// Greatest extents of the bounding box in the object frame (x, y, z), metres.
    pub greatest: [f64; 3],
    /// Least and greatest mass, kilograms.
    pub mass: [f64; 2],
    /// Sources of sizes and masses.
    pub source: &'static str,
}

/// "YCB" in a source is Calli et al., "Benchmarking in manipulation research: the YCB object and model set and
/// benchmarking protocols", IEEE Robotics and Automation Magazine, 2015, which tables sizes and masses.
const FACTS: &[FamilyFacts] = &[
    FamilyFacts {
        family: Family::Box,
        name: "box",
        least: [0.025, 0.025, 0.024],
        greatest: [0.32, 0.2, 0.32],
        mass: [0.003, 3.0],
        source: "YCB gelatin, pudding, sugar and cracker boxes: 28 to 60 mm thick, 206 to 868 kg/m3",
    },
    FamilyFacts {
        family: Family::WoodBlock,
        name: "wood_block",
        least: [0.021, 0.021, 0.013],
        greatest: [0.111, 0.056, 0.056],
        mass: [0.002, 0.25],
        source: "toy blocks of 1 to 2 inches, as in YCB; pine to beech, 450 to 750 kg/m3",
    },
    FamilyFacts {
        family: Family::Can,
        name: "can",
        least: [0.05, 0.05, 0.02],
        greatest: [0.105, 0.105, 0.17],
        mass: [0.03, 1.2],
        source: "YCB tuna, soup and coffee cans: 66 to 102 mm wide, 33 to 139 mm high, 360 to 1010 kg/m3",
    },
    FamilyFacts {
        family: Family::Bottle,
        name: "bottle",
        least: [0.043, 0.028, 0.06],
        greatest: [0.085, 0.085, 0.26],
        mass: [0.03, 1.2],
        source: "YCB mustard (58 x 95 x 190 mm, 603 g) and bleach bottles; drinks and shampoo of 50 ml to 0.8 l, full",
    },
    FamilyFacts {
        family: Family::Ball,
        name: "ball",
        least: [0.0395, 0.0395, 0.0395],
        greatest: [0.0981, 0.0981, 0.0981],
        mass: [0.0026, 0.198],
        source: "rules of table tennis, golf, tennis, baseball and softball",
    },
    FamilyFacts {
        family: Family::Superquadric,
        name: "superquadric",
        least: [0.031, 0.031, 0.031],
        greatest: [0.085, 0.085, 0.085],
        mass: [0.003, 0.6],
        source: "free shapes of palm size, 32 to 84 mm; cork to plastic, 300 to 1100 kg/m3",
    },
    FamilyFacts {
        family: Family::Cup,
        name: "cup",
        least: [0.05, 0.05, 0.035],
        greatest: [0.096, 0.096, 0.14],
        mass: [0.01, 0.5],
        source: "YCB stacking cups (51 to 93 mm wide); drinking glasses of 0.1 to 0.4 l",
    },
    FamilyFacts {
        family: Family::Bowl,
        name: "bowl",
        least: [0.09, 0.09, 0.02],
        greatest: [0.18, 0.18, 0.09],
        mass: [0.03, 0.8],
        source: "YCB bowl (159 mm wide, 53 mm high); cereal and dessert bowls",
    },
    FamilyFacts {
        family: Family::Plate,
        name: "plate",
        least: [0.14, 0.14, 0.009],
        greatest: [0.28, 0.28, 0.04],
        mass: [0.05, 1.2],
        source: "side to dinner plates, 150 to 270 mm; YCB plate 258 mm",
    },
    FamilyFacts {
        family: Family::WineGlass,
        name: "wine_glass",
        least: [0.055, 0.055, 0.1],
        greatest: [0.1, 0.1, 0.22],
        mass: [0.02, 0.4],
        source: "port to wine glasses, 110 to 200 mm high; YCB wine cup",
    },
    FamilyFacts {
        family: Family::Mug,
        name: "mug",
        least: [0.1, 0.07, 0.065],
        greatest: [0.14, 0.1, 0.12],
        mass: [0.05, 0.7],
        source: "YCB mug (80 mm high, 118 g of enamel); ceramic mugs of 0.2 to 0.5 l",
    },
    FamilyFacts {
        family: Family::Fruit,
        name: "fruit",
        least: [0.04, 0.04, 0.04],
        greatest: [0.085, 0.085, 0.115],
        mass: [0.04, 0.36],
        source: "YCB apple, orange, lemon, pear, peach: 54 to 75 mm wide; real fruit, 820 to 1000 kg/m3",
    },
    FamilyFacts {
        family: Family::Banana,
        name: "banana",
        least: [0.12, 0.04, 0.028],
        greatest: [0.21, 0.12, 0.044],
        mass: [0.06, 0.25],
        source: "YCB banana (190 mm long, 36 mm thick); real fruit, 900 to 1000 kg/m3",
    },
    FamilyFacts {
        family: Family::Hammer,
        name: "hammer",
        least: [0.2, 0.08, 0.015],
        greatest: [0.36, 0.13, 0.07],
        mass: [0.15, 1.1],
        source: "YCB hammer (665 g); cross-peen hammers with heads of 100 to 800 g",
    },
    FamilyFacts {
        family: Family::Screwdriver,
        name: "screwdriver",
        least: [0.15, 0.02, 0.02],
        greatest: [0.27, 0.04, 0.04],
        mass: [0.03, 0.3],
        source: "YCB screwdrivers (31 x 215 mm, 98 g)",
    },
    FamilyFacts {
        family: Family::Scissors,
        name: "scissors",
        least: [0.12, 0.05, 0.006],
        greatest: [0.21, 0.12, 0.012],
        mass: [0.03, 0.2],
        source: "YCB scissors (87 x 200 x 14 mm, 82 g)",
    },
    FamilyFacts {
        family: Family::Fork,
        name: "fork",
        least: [0.15, 0.012, 0.006],
        greatest: [0.22, 0.03, 0.03],
        mass: [0.004, 0.08],
        source: "YCB fork (198 mm, 34 g); steel and plastic cutlery",
    },
    FamilyFacts {
        family: Family::Spoon,
        name: "spoon",
        least: [0.13, 0.03, 0.008],
        greatest: [0.21, 0.05, 0.03],
        mass: [0.004, 0.1],
        source: "YCB spoon (195 mm, 30 g); steel and plastic cutlery",
    },
    FamilyFacts {
        family: Family::Clamp,
        name: "clamp",
        least: [0.07, 0.05, 0.008],
        greatest: [0.18, 0.12, 0.025],
        mass: [0.03, 0.8],
        source: "YCB clamps (medium to extra large, 59 to 202 g); C-clamps of 50 to 80 mm, iron or aluminium",
    },
    FamilyFacts {
        family: Family::Chain,
        name: "chain",
        least: [0.05, 0.015, 0.015],
        greatest: [0.24, 0.045, 0.045],
        mass: [0.003, 0.5],
        source: "YCB plastic chain (98 g); links of 3 to 4.5 mm rod",
    },
    FamilyFacts {
        family: Family::Ring,
        name: "ring",
        least: [0.045, 0.045, 0.009],
        greatest: [0.12, 0.12, 0.024],
        mass: [0.005, 0.2],
        source: "toy rings, bangles and rolls, 50 to 116 mm wide",
    },
    FamilyFacts {
        family: Family::Kettle,
        name: "kettle",
        least: [0.12, 0.095, 0.125],
        greatest: [0.18, 0.122, 0.19],
        mass: [0.15, 0.6],
        source: "small tea and stove kettles of 0.4 to 1 l, sheet steel of 0.5 to 0.9 mm, empty",
    },
    FamilyFacts {
        family: Family::Prism,
        name: "prism",
        least: [0.0121, 0.0121, 0.0139],
        greatest: [0.221, 0.221, 0.221],
        mass: [0.0005, 0.901],
        source: "YCB wood block (85 x 85 x 200 mm, 729 g), foam brick and dice; light wood to plastic, 360 to 1200 kg/m3, less where it would weigh over 0.9 kg",
    },
    FamilyFacts {
        family: Family::Bracket,
        name: "bracket",
        least: [0.05, 0.02, 0.0079],
        greatest: [0.26, 0.21, 0.025],
        mass: [0.002, 0.601],
        source: "L, T, U, H and Z shapes of 8 to 24 mm bar or rod, 50 to 180 mm long; wood, plastic, aluminium or steel",
    },
    FamilyFacts {
        family: Family::Carton,
        name: "carton",
        least: [0.0599, 0.0599, 0.0599],
        greatest: [0.241, 0.241, 0.241],
        mass: [0.05, 1.001],
        source: "filled cartons, canisters and timber 60 to 94 mm thick, 430 to 950 kg/m3, less where it would weigh over 1 kg",
    },
];

impl Family {
    /// Every family, in the order of its number.
    pub const ALL: [Family; FACTS.len()] = {
        let mut all = [Family::Box; FACTS.len()];
        let mut i = 0;
        while i < FACTS.len() {
            all[i] = FACTS[i].family;
            i += 1;
        }
        all
    };

    /// The ranges of size and mass that every object of the family keeps, and their source.
    pub fn facts(self) -> &'static FamilyFacts {
        &FACTS[self as usize]
    }

    /// The name in object sets, snake_case.
    pub fn name(self) -> &'static str {
        self.facts().name
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A name that no family has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not a family of procedural objects; the families are {names}", names = known_names())]
pub struct UnknownFamily(pub String);

fn known_names() -> String {
    Family::ALL.map(Family::name).join(", ")
}

impl FromStr for Family {
    type Err = UnknownFamily;

    fn from_str(name: &str) -> Result<Self, UnknownFamily> {
        let known = FACTS.iter().find(|facts| facts.name == name);
        known.map(|facts| facts.family).ok_or_else(|| UnknownFamily(name.to_owned()))
    }
}
