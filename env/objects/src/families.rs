//! The families' shapes: from a random stream to a draft of one object.

mod brackets;
mod cutlery;
mod food;
mod handled;
mod kettle;
mod packages;
mod prisms;
mod rounds;
mod tools;
mod vessels;

use crate::draft::Draft;
use crate::family::Family;
use crate::sample::Sampler;
use graspbox_mesh::MeshError;

/// An object of `family`, in its construction frame.
pub(crate) fn draft(family: Family, sampler: &mut Sampler) -> Result<Draft, MeshError> {
    Ok(match family {
        Family::Box => packages::grocery_box(sampler),
        Family::WoodBlock => packages::wood_block(sampler),
        Family::Can => packages::can(sampler),
        Family::Bottle => packages::bottle(sampler),
        Family::Ball => rounds::ball(sampler)?,
        Family::Cup => vessels::cup(sampler),
        Family::Bowl => vessels::bowl(sampler),
        Family::Plate => vessels::plate(sampler),
        Family::WineGlass => vessels::wine_glass(sampler),
        Family::Mug => handled::mug(sampler),
        Family::Fruit => food::fruit(sampler)?,
        Family::Banana => food::banana(sampler)?,
        Family::Hammer => tools::hammer(sampler)?,
        Family::Screwdriver => tools::screwdriver(sampler)?,
        Family::Scissors => cutlery::scissors(sampler)?,
        Family::Fork => cutlery::fork(sampler)?,
        Family::Spoon => cutlery::spoon(sampler)?,
        Family::Clamp => tools::clamp(sampler)?,
        Family::Chain => tools::chain(sampler)?,
        Family::Ring => tools::ring(sampler)?,
        Family::Kettle => kettle::kettle(sampler)?,
        Family::Superquadric => rounds::superquadric(sampler)?,
        Family::Prism => prisms::prism(sampler),
        Family::Bracket => brackets::bracket(sampler)?,
        Family::Carton => prisms::carton(sampler),
    })
}
