//! Order of an island's objects among the unknowns: objects that touch stand close together, so that factors of the derivative keep their zeros.

/// Objects as bits; [`crate::limits::MAX_OBJECTS`] of them fit.
pub(crate) type Set = u64;

/// The set of one object.
pub(crate) fn only(object: usize) -> Set {
    1 << object
}

/// The objects of a set, ascending.
fn members(set: Set) -> impl Iterator<Item = usize> {
    (0..Set::BITS as usize).filter(move |object| set & only(*object) != 0)
}

/// Orders `objects`, which are ascending, by a breadth-first search with few neighbours first (Cuthill and McKee, 1969): from `first`, which
/// stay in front, or if that is empty from the objects with the fewest neighbours, and then reversed (George, 1971).
///
/// * `neighbours`: by object, those that it touches.
pub(crate) fn order(objects: &mut [usize], neighbours: &[Set], first: Set) {
    let mut left = objects.iter().fold(0, |set, object| set | only(*object));
    let (mut placed, mut expanded) = (0, 0);
    let mut found = first & left;
    while placed < objects.len() {
        if found == 0 && expanded < placed {
            found = left & neighbours[objects[expanded]];
            expanded += 1;
            continue;
        }
        let candidates = if found == 0 { left } else { found };
        let Some(next) = members(candidates).min_by_key(|object| neighbours[*object].count_ones()) else { return };
        objects[placed] = next;
        placed += 1;
        left &= !only(next);
        found &= !only(next);
    }
    if first == 0 {
        objects.reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greatest distance in the order between two objects that touch.
    fn bandwidth(objects: &[usize], neighbours: &[Set]) -> usize {
        let place = |object: usize| objects.iter().position(|o| *o == object).unwrap_or(usize::MAX);
        let apart = |a: usize| members(neighbours[a]).map(move |b| place(a).abs_diff(place(b)));
        objects.iter().flat_map(|a| apart(*a)).max().unwrap_or(0)
    }

    fn graph(edges: &[(usize, usize)]) -> Vec<Set> {
        let mut neighbours = vec![0; 64];
        for &(a, b) in edges {
            neighbours[a] |= only(b);
            neighbours[b] |= only(a);
        }
        neighbours
    }

    #[test]
    fn objects_that_touch_stand_close_together() {
        // A chain whose numbers jump, and objects 2 and 63 apart from it.
        let chain = graph(&[(0, 40), (40, 3), (3, 50), (50, 7), (2, 63)]);
        let mut objects = vec![0, 2, 3, 7, 40, 50, 63];
        order(&mut objects, &chain, 0);
        assert_eq!(bandwidth(&objects, &chain), 1, "{objects:?}");
        objects.sort_unstable();
        assert_eq!(objects, [0, 2, 3, 7, 40, 50, 63]);
        // With an end of the chain in front.
        order(&mut objects, &chain, only(7));
        assert_eq!(objects, [7, 50, 3, 40, 0, 2, 63]);
        // A wall of 4 x 8 bricks, numbered along its rows of 8: the order runs along the short side.
        let brick = |x: usize, y: usize| 8 * y + x;
        let rows = (0..4).flat_map(|y| (0..7).map(move |x| (brick(x, y), brick(x + 1, y))));
        let columns = (0..3).flat_map(|y| (0..8).map(move |x| (brick(x, y), brick(x, y + 1))));
        let wall = graph(&rows.chain(columns).collect::<Vec<_>>());
        let mut objects: Vec<usize> = (0..32).collect();
        assert_eq!(bandwidth(&objects, &wall), 8);
        order(&mut objects, &wall, 0);
        assert!(bandwidth(&objects, &wall) <= 5, "{objects:?}");
    }
}
