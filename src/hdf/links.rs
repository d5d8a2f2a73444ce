//! The links of a file. The library would follow a link to another file into any file, even a pipe.

use hdf5::{File, Group, IndexType, IterationOrder, LinkType, LocationType};

use super::error::Failure;

/// Maximum number of datasets that are listed.
const DATASETS: usize = 1000;

/// Maximum number of links that are visited.
const LINKS: usize = 20_000;

/// What a file contains.
#[derive(Default)]
pub(super) struct Contents {
    /// The paths of its datasets, up to a maximum.
    pub datasets: Vec<String>,
    /// Whether a link leads to another file, or not all links have been visited.
    leads_outside: bool,
    /// The path of its first link, to another file if there is such a one.
    link: Option<(String, LinkType)>,
}

impl Contents {
    /// Returns the paths of the datasets.
    ///
    /// # Errors
    /// If there are none, but a link that leads to another file or nowhere.
    pub fn named(self, file: &File) -> Result<Vec<String>, Failure> {
        let refused = |name: &str, why: &str| {
            let why = format!("it contains no datasets, only links: {name:?} leads {why}");
            Err(Failure::Refused(why))
        };
        match self.link.filter(|_| self.datasets.is_empty()) {
            Some((name, LinkType::External)) => refused(&name, "to another file, which is not opened"),
            Some((name, LinkType::Soft)) if file.loc_type_by_name(&name).is_err() => refused(&name, "nowhere"),
            _ => Ok(self.datasets),
        }
    }
}

/// Lists the datasets of a file, in the order of their names.
pub(super) fn contents(file: &File) -> hdf5::Result<Contents> {
    let mut found = Contents::default();
    let mut open: Vec<(Group, String)> = vec![(file.as_group()?, String::new())];
    let mut visited = 0;
    while let Some((group, path)) = open.pop() {
        let mut groups = Vec::new();
        for (name, link) in group.links(IndexType::Name, IterationOrder::Increasing)? {
            visited += 1;
            if visited > LINKS {
                found.leads_outside = true;
                return Ok(found);
            }
            match link.link_type {
                LinkType::External => {
                    found.leads_outside = true;
                    found.link = Some((format!("{path}{name}"), LinkType::External));
                }
                LinkType::Soft => {
                    found
                        .link
                        .get_or_insert_with(|| (format!("{path}{name}"), LinkType::Soft));
                }
                LinkType::Hard => match group.loc_type_by_name(&name)? {
                    LocationType::Group => groups.push((group.group(&name)?, format!("{path}{name}/"))),
                    LocationType::Dataset if found.datasets.len() < DATASETS => {
                        found.datasets.push(format!("{path}{name}"));
                    }
                    _ => {}
                },
            }
        }
        open.extend(groups.into_iter().rev());
    }
    Ok(found)
}

/// Whether a group has an object of that name. A link is followed if no link of its file leads to another file.
pub(super) fn is_here(file: &File, group: &Group, name: &str) -> Result<bool, Failure> {
    let found = group.find_link(IndexType::Name, IterationOrder::Native, |other, info| {
        Ok((other == name).then_some(info.link_type))
    });
    let refused = |why: &str| Err(Failure::Refused(format!("{name:?} is a link {why}")));
    match found? {
        None => Ok(false),
        Some(LinkType::Hard) => Ok(true),
        Some(LinkType::External) => refused("to another file"),
        Some(LinkType::Soft) if contents(file)?.leads_outside => refused("in a file with links to other files"),
        Some(LinkType::Soft) => match group.loc_type_by_name(name) {
            Ok(_) => Ok(true),
            Err(_) => refused("that leads nowhere"),
        },
    }
}
