//! Which stages of a sweep belong together: those whose common axes have the same values.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use super::settings::{Setting, Settings, joined, key, value_of};

/// Settings that are found by values of axes.
pub struct Matching<'a> {
    all: Vec<&'a [Setting]>,
    /// Those that have the same axes, by their places.
    groups: Vec<(Vec<Rc<str>>, Vec<usize>)>,
    /// Places by the values of some axes of a group: looked for once.
    places: HashMap<(usize, Vec<usize>), HashMap<String, Vec<usize>>>,
}

impl<'a> Matching<'a> {
    pub fn new(all: Vec<&'a [Setting]>) -> Self {
        let mut groups: Vec<(Vec<Rc<str>>, Vec<usize>)> = Vec::new();
        for (place, settings) in all.iter().enumerate() {
            let axes: Vec<Rc<str>> = settings.iter().map(|setting| setting.axis.clone()).collect();
            match groups.iter_mut().find(|(known, _)| *known == axes) {
                Some((_, places)) => places.push(place),
                None => groups.push((axes, vec![place])),
            }
        }
        Self {
            all,
            groups,
            places: HashMap::new(),
        }
    }

    /// Places of those that contradict no value of `row`, in their order.
    pub fn of(&mut self, row: &[Setting]) -> Vec<usize> {
        let mut found = Vec::new();
        for (group, (axes, members)) in self.groups.iter().enumerate() {
            let has = |at: &usize| value_of(row, &axes[*at]).is_some();
            let common: Vec<usize> = (0..axes.len()).filter(has).collect();
            let wanted = common.iter().filter_map(|&at| value_of(row, &axes[at]));
            let wanted: Vec<&str> = wanted.map(|value| value.text.as_str()).collect();
            let all = &self.all;
            let places = self.places.entry((group, common.clone())).or_insert_with(|| {
                let mut places: HashMap<String, Vec<usize>> = HashMap::new();
                for &member in members {
                    let own: Vec<&str> = common.iter().map(|&at| all[member][at].value.text.as_str()).collect();
                    places.entry(own.join("\n")).or_default().push(member);
                }
                places
            });
            found.extend(places.get(&wanted.join("\n")).into_iter().flatten());
        }
        found.sort_unstable();
        found
    }
}

/// All combinations of one of each list that do not contradict each other; none where there would be more than `most`.
pub fn combined(lists: &[Vec<&[Setting]>], most: usize) -> Option<Vec<Settings>> {
    let mut rows: Vec<Settings> = vec![Vec::new()];
    for list in lists {
        let mut matching = Matching::new(list.clone());
        let mut longer = Vec::new();
        for row in &rows {
            let found = matching.of(row);
            if longer.len() + found.len() > most {
                return None;
            }
            longer.extend(found.into_iter().map(|place| joined(row, list[place])));
        }
        rows = longer;
    }
    Some(rows)
}

/// Settings of those axes that go on, each combination once, in order.
pub fn projected(list: &[&[Setting]], goes_on: &dyn Fn(&str) -> bool) -> Vec<Settings> {
    let mut seen = BTreeSet::new();
    let own = |settings: &&[Setting]| -> Settings {
        let kept = settings.iter().filter(|setting| goes_on(&setting.axis));
        kept.cloned().collect()
    };
    list.iter()
        .map(own)
        .filter(|settings| seen.insert(key(settings)))
        .collect()
}
