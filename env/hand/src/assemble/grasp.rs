//! The table `[grasp]`: closing actuators and preshapes.

use crate::error::ProblemKind;
use crate::grasp::{FaceRule, Grasp, Preshape, PreshapeCoordinate};
use crate::model::{Hand, Transmission};
use crate::table::{CoordinateTable, GraspTable, HandTable, Item, Number, PreshapeTable, Reader};
use nalgebra::Point3;
use toml::Spanned;

use super::names::find;

/// Rounding that is accepted at limits, rad or m.
const ROUNDING: f64 = 1e-9;

/// Reads the table; `None` where a name cannot be resolved.
pub(super) fn read(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<()> {
    let written = &table.grasp;
    let center = Point3::from(reader.value("center", &written.center, "m"));
    let closing = read_closing(hand, table, reader)?;
    let coordinate = match &written.coordinate {
        Some(coordinate) => Some(read_coordinate(hand, coordinate, &closing, reader)?),
        None => None,
    };
    let item = ("grasp of", table.name.get_ref().as_str());
    let mut range = |field, written: &Option<Number<[f64; 2]>>| {
        written.as_ref().map_or([0.0; 2], |range| reader.interval(item, field, range, "m"))
    };
    let closing_range = range("closing_range", &written.closing_range);
    let side_range = range("side_range", &written.side_range);
    let mut turn = |field, written: &Option<Number<f64>>| {
        written.as_ref().map_or(0.0, |turn| reader.not_negative(item, field, turn, "rad"))
    };
    let (max_roll, max_lean) = (turn("max_roll", &written.max_roll), turn("max_lean", &written.max_lean));
    let weight = |(name, number): (&Spanned<String>, &Number<f64>)| {
        (name.get_ref().clone(), reader.value("weight of the ranking", number, "1"))
    };
    let ranking = written.ranking.iter().map(weight).collect();
    hand.grasp = Grasp {
        center,
        closing,
        closing_range,
        side_range,
        max_roll,
        max_lean,
        coordinate,
        preshapes: Vec::new(),
        ranking,
    };
    let preshapes = read_preshapes(hand, written, reader)?;
    hand.grasp.preshapes = if preshapes.is_empty() { default_preshapes(coordinate) } else { preshapes };
    Some(())
}

fn find_actuator(hand: &Hand, name: &Spanned<String>, reader: &mut Reader<'_, '_>) -> Option<usize> {
    find(name, "actuator", hand.actuators.iter().map(|actuator| &actuator.name), reader)
}

fn read_closing(hand: &Hand, table: &HandTable, reader: &mut Reader<'_, '_>) -> Option<Vec<usize>> {
    let mut closing = Vec::with_capacity(table.grasp.closing.len());
    for name in &table.grasp.closing {
        let actuator = find_actuator(hand, name, reader)?;
        if closing.contains(&actuator) {
            let kind = ProblemKind::UsedTwice { what: "actuator", name: name.get_ref().clone(), by: "`closing`" };
            reader.add(name, kind);
        }
        closing.push(actuator);
    }
    if closing.is_empty() {
        reader.add(&table.name, ProblemKind::Empty("closing actuators"));
    }
    closing.sort_unstable();
    Some(closing)
}

fn read_coordinate(
    hand: &Hand,
    written: &CoordinateTable,
    closing: &[usize],
    reader: &mut Reader<'_, '_>,
) -> Option<PreshapeCoordinate> {
    let actuator = find_actuator(hand, &written.actuator, reader)?;
    let name = written.actuator.get_ref();
    if closing.contains(&actuator) {
        let kind = ProblemKind::UsedTwice { what: "actuator", name: name.clone(), by: "`closing` and `coordinate`" };
        reader.add(&written.actuator, kind);
    }
    let driver = &hand.actuators[actuator];
    let limits = reader.interval(("preshape of actuator", name), "limits", &written.limits, hand.position_unit(driver));
    let [least, greatest] = driver.travel;
    if limits[0] < least - ROUNDING || limits[1] > greatest + ROUNDING {
        let ([lower, upper], must) = (limits, "they must lie within its travel");
        let (item, name, quantity) = ("preshape of actuator", name.clone(), "limits");
        reader.add(&written.limits, ProblemKind::Interval { item, name, quantity, lower, upper, must });
    }
    if let Transmission::Joints { joints, .. } = &driver.transmission {
        for driven in joints {
            let [lower, upper] = hand.joints[driven.joint].limits;
            let led = limits.map(|limit| driven.ratio * limit + driven.offset);
            if led.iter().any(|position| !(lower - ROUNDING..=upper + ROUNDING).contains(position)) {
                let must = "it must hold the preshape limits, times the ratio, plus the offset";
                let (name, quantity) = (hand.joints[driven.joint].name.clone(), "limit");
                reader.add(
                    &written.actuator,
                    ProblemKind::Interval { item: "joint", name, quantity, lower, upper, must },
                );
            }
        }
    }
    Some(PreshapeCoordinate { actuator, limits })
}

fn read_preshapes(hand: &Hand, table: &GraspTable, reader: &mut Reader<'_, '_>) -> Option<Vec<Preshape>> {
    let mut preshapes: Vec<Preshape> = Vec::with_capacity(table.preshapes.len());
    for (number, written) in table.preshapes.iter().enumerate() {
        let name = written.name.get_ref();
        if preshapes.iter().any(|other| other.name == *name) {
            reader.add(&written.name, ProblemKind::Duplicate { what: "preshape", name: name.clone() });
        }
        let mut positions = Vec::with_capacity(written.positions.len());
        for (actuator, position) in &written.positions {
            let index = find_actuator(hand, actuator, reader)?;
            positions.push((index, read_position(hand, name, index, position, reader)));
        }
        let item: Item<'_> = ("preshape", name);
        let optional = |number: &Option<Number<f64>>, quantity, unit, default, reader: &mut Reader<'_, '_>| {
            number.as_ref().map_or(default, |number| reader.not_negative(item, quantity, number, unit))
        };
        let face = FaceRule {
            length: range(written.length.as_ref(), item, "length", reader),
            width: range(written.width.as_ref(), item, "width", reader),
            max_ratio: optional(&written.max_ratio, "max_ratio", "1", f64::INFINITY, reader),
            any_ratio_below: optional(&written.any_ratio_below, "any_ratio_below", "m", 0.0, reader),
            quarter: written.quarter,
        };
        let preference = written.preference.as_ref().map_or(0.0, |number| reader.value("preference", number, "1"));
        let value = value_of(hand, number, &positions, written, reader);
        preshapes.push(Preshape { name: name.clone(), value, positions, face, preference });
    }
    Some(preshapes)
}

fn range(
    number: Option<&Number<[f64; 2]>>,
    item: Item<'_>,
    quantity: &'static str,
    reader: &mut Reader<'_, '_>,
) -> [f64; 2] {
    number.map_or([0.0, f64::INFINITY], |number| reader.interval(item, quantity, number, "m"))
}

/// A position of a preshape, which must lie within the travel.
fn read_position(
    hand: &Hand,
    preshape: &str,
    actuator: usize,
    number: &Number<f64>,
    reader: &mut Reader<'_, '_>,
) -> f64 {
    let actuator = &hand.actuators[actuator];
    let value = reader.value("position", number, hand.position_unit(actuator));
    let [least, greatest] = actuator.travel;
    if value < least - ROUNDING || value > greatest + ROUNDING {
        let (item, name, must) = ("preshape", preshape.to_owned(), "within the travel of its actuator");
        reader.add(number, ProblemKind::Value { item, name, quantity: "position", value, must });
    }
    value
}

/// The number of a preshape: a position of the coordinate, or its place in the list.
fn value_of(
    hand: &Hand,
    number: usize,
    positions: &[(usize, f64)],
    written: &PreshapeTable,
    reader: &mut Reader<'_, '_>,
) -> f64 {
    let Some(coordinate) = hand.grasp.coordinate else {
        return number as f64;
    };
    match positions {
        [(actuator, position)] if *actuator == coordinate.actuator => {
            let [low, high] = coordinate.limits;
            if !(low - ROUNDING..=high + ROUNDING).contains(position) {
                let (item, name, must) = ("preshape", written.name.get_ref().clone(), "within the preshape limits");
                let kind = ProblemKind::Value { item, name, quantity: "position", value: *position, must };
                reader.add(&written.name, kind);
            }
            *position
        }
        _ => {
            let (item, name) = ("preshape", written.name.get_ref().clone());
            let actuator = coordinate.actuator;
            let kind = if positions.iter().any(|(other, _)| *other == actuator) {
                ProblemKind::OtherActuators { preshape: name, coordinate: hand.actuators[actuator].name.clone() }
            } else {
                ProblemKind::Missing { item, name, missing: "position of the preshape coordinate" }
            };
            reader.add(&written.name, kind);
            0.0
        }
    }
}

/// Both ends and the middle of the coordinate, or the open hand.
fn default_preshapes(coordinate: Option<PreshapeCoordinate>) -> Vec<Preshape> {
    let preshape = |name: &str, value: f64, positions: Vec<(usize, f64)>| Preshape {
        name: name.to_owned(),
        value,
        positions,
        face: FaceRule::default(),
        preference: 0.0,
    };
    let Some(PreshapeCoordinate { actuator, limits: [low, high] }) = coordinate else {
        return vec![preshape("open", 0.0, Vec::new())];
    };
    let at = |(name, value): (&str, f64)| preshape(name, value, vec![(actuator, value)]);
    [("least", low), ("middle", 0.5 * (low + high)), ("greatest", high)].into_iter().map(at).collect()
}
