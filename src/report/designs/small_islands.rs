//! Electrodes that are too small to be made, or to be connected.

use deaflow_content::GENOME_UNITS;
use deaflow_pattern::{Bits, Pattern};

/// Counts the separate electrodes, each of which needs a lead; `None` if each group is one piece.
pub(crate) fn separate_electrodes(pattern: &Pattern) -> Option<usize> {
    let groups = 1..=u8::try_from(pattern.groups()).unwrap_or(u8::MAX);
    let pieces: Vec<usize> = groups.map(|group| pattern.of_group(group).islands().len()).collect();
    pieces.iter().any(|pieces| *pieces > 1).then(|| pieces.iter().sum())
}

/// Says how many islands of a pattern are smaller than a unit of the genetic algorithm, as those that a search by
/// single cells may leave; `None` if none is.
pub(crate) fn small_islands(pattern: &Pattern) -> Option<String> {
    let raster = pattern.raster();
    let unit = raster.cells() as f64 / raster.unit_sides(GENOME_UNITS as u64).iter().product::<usize>() as f64;
    let sizes: Vec<usize> = pattern.islands().iter().map(Bits::count).collect();
    let small = sizes.iter().filter(|cells| (**cells as f64) < unit).count();
    let least = sizes.last().filter(|_| small > 0)?;
    let all = sizes.len();
    let cells = if *least == 1 {
        "1 cell".to_owned()
    } else {
        format!("{least} cells")
    };
    Some(format!(
        "{small} of {all} electrodes are smaller than a unit, down to {cells}: set `min_feature` or `islands`"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn separate_electrodes_are_counted() {
        let of = |is: &dyn Fn(usize, usize) -> bool| separate_electrodes(&Pattern::from_fn(Raster::PAPER, is));
        assert_eq!(of(&|x, _| x < 20), None);
        assert_eq!(of(&|_, _| false), None);
        assert_eq!(of(&|x, y| x % 20 < 5 && y < 30), Some(3));
        // Groups that touch are separate anyway.
        let groups = Pattern::from_groups(Raster::PAPER, |x, _| if x < 20 { 1 } else { 2 });
        assert_eq!(separate_electrodes(&groups), None);
    }

    #[test]
    fn electrodes_below_a_unit_are_counted() {
        let half = |x: usize, _: usize| x < 20;
        let of = |is: &dyn Fn(usize, usize) -> bool| small_islands(&Pattern::from_fn(Raster::PAPER, is));
        assert_eq!(of(&half), None);
        // Six of 6.25 cells, and a single one that touches another island at a corner only.
        let specks = |x: usize, y: usize| half(x, y) || ((30..33).contains(&x) && y < 2) || [x, y] == [33, 2];
        assert_eq!(
            of(&specks).as_deref(),
            Some("2 of 3 electrodes are smaller than a unit, down to 1 cell: set `min_feature` or `islands`")
        );
        let unit = |x: usize, y: usize| half(x, y) || ((30..33).contains(&x) && y < 3);
        assert_eq!(of(&unit), None);
        // Where units are cells, none is smaller.
        let coarse = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| (x + y) % 2 == 0);
        assert_eq!(small_islands(&coarse), None);
    }
}
