//! The leads that connect the electrodes with the source.

use super::sides::{SideSupport, Sides};
use deaflow_base::{Canonical, Declared, InputError, Node, NodeValue, Parameter, Schema, parameters, words};
use deaflow_pattern::{Bits, Membrane, Pattern, Raster};

words! {
    /// A side of the membrane.
    pub enum Edge {
        /// x = 0.
        Left = "left",
        /// The other end of x.
        Right = "right",
        /// y = 0.
        Bottom = "bottom",
        /// The other end of y.
        Top = "top",
    }
}

parameters! {
    /// Cells with leads.
    struct LeadCells as "`leads`" {
        /// Column and row of each, from 0 at the lower left.
        cells: Vec<[usize; 2]> [(0..=Raster::MOST as u64 - 1, 1..=MOST_CELLS)],
    }
}

const MOST_CELLS: usize = Raster::MOST * Raster::MOST;

/// The positions of the leads. Where a lead touches an electrode, the electrode has the voltage of the source at once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Leads {
    /// Along entire sides of the membrane.
    Edges(Vec<Edge>),
    /// On some cells, by column and row.
    Cells(Vec<[usize; 2]>),
}

/// A part of an electrode that is not connected to a lead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unreached {
    /// The number of its cells.
    pub cells: usize,
    /// The column and row of its lowest, then leftmost cell.
    pub at: [usize; 2],
}

impl Leads {
    /// Returns whether there is a lead along a side.
    #[must_use]
    pub fn is_along(&self, edge: Edge) -> bool {
        matches!(self, Self::Edges(edges) if edges.contains(&edge))
    }

    /// Returns whether there is a lead on a cell.
    #[must_use]
    pub fn is_on(&self, cell: [usize; 2]) -> bool {
        matches!(self, Self::Cells(cells) if cells.contains(&cell))
    }

    /// Returns the cells that leads touch.
    #[must_use]
    pub fn touched(&self, raster: Raster) -> Bits {
        let [columns, rows] = raster.sides();
        match self {
            Self::Edges(edges) => Bits::from_fn(raster, |x, y| {
                edges.iter().any(|edge| match edge {
                    Edge::Left => x == 0,
                    Edge::Right => x + 1 == columns,
                    Edge::Bottom => y == 0,
                    Edge::Top => y + 1 == rows,
                })
            }),
            Self::Cells(cells) => {
                let mut touched = vec![false; raster.cells()];
                let within = cells.iter().filter(|[x, y]| *x < columns && *y < rows);
                within.for_each(|[x, y]| touched[y * columns + x] = true);
                Bits::from_fn(raster, |x, y| touched[y * columns + x])
            }
        }
    }

    /// Returns the first connected part of an electrode group that no lead reaches; cells are connected by their sides.
    #[must_use]
    pub fn unreached(&self, pattern: &Pattern) -> Option<Unreached> {
        let touched = self.touched(pattern.raster());
        let of_group = |group: usize| {
            let electrode = Bits::of(&pattern.of_group(group as u8));
            let left = electrode.without(&electrode.flooded(&touched));
            let island = left.flooded(&left.first());
            let [columns, _] = island.sides();
            let first = (0..pattern.raster().cells()).find(|at| island.has(at % columns, at / columns))?;
            Some(Unreached {
                cells: island.count(),
                at: [first % columns, first / columns],
            })
        };
        (1..=pattern.groups()).find_map(of_group)
    }

    /// Checks that leads are on cells of the membrane, or along sides that are held or have a bar; `node` is the node
    /// of the leads.
    pub(super) fn check(&self, node: &Node, membrane: Membrane, sides: Option<&Sides>) -> Result<(), InputError> {
        let [columns, rows] = membrane.raster.sides();
        let beyond = |[x, y]: &&[usize; 2]| *x >= columns || *y >= rows;
        match self {
            Self::Cells(cells) => match cells.iter().find(beyond) {
                Some([x, y]) => Err(node
                    .error(format!("the cell [{x}, {y}] of a lead does not exist"))
                    .help(format!(
                        "the membrane has {columns} columns and {rows} rows, counted from 0"
                    ))),
                None => Ok(()),
            },
            Self::Edges(edges) => {
                let bears = |edge: &&Edge| {
                    let support = sides.map(|sides| sides.of(**edge));
                    support.is_none_or(|support| *support == SideSupport::Held || support.bar().is_some())
                };
                match edges.iter().find(|edge| !bears(edge)) {
                    Some(edge) => Err(node
                        .error(format!(
                            "nothing holds a lead along the {} side of the membrane",
                            edge.name()
                        ))
                        .help("leads are along sides that are held or have a bar, or on `cells`")),
                    None => Ok(()),
                }
            }
        }
    }
}

impl Parameter for Leads {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::List(_) => {
                let mut edges: Vec<Edge> = Vec::read(node, key, &((), 1..=Edge::ALL.len()))?;
                edges.sort_unstable();
                edges.dedup();
                Ok(Self::Edges(edges))
            }
            NodeValue::Map(_) => {
                let LeadCells { mut cells } = LeadCells::read_with(node, &[])?;
                cells.sort_unstable();
                cells.dedup();
                Ok(Self::Cells(cells))
            }
            _ => Err(node
                .error(format!(
                    "`{key}` must be a list of sides or cells, found {}",
                    node.found()
                ))
                .help(format!(
                    "for example [left], of {}, or {{ cells: [[0, 0], [1, 0]] }}",
                    Edge::WORDS.join(", ")
                ))),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Edges(edges) => edges.canonical(),
            Self::Cells(cells) => Some(LeadCells { cells: cells.clone() }.to_canonical()),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Vec::<Edge>::schema(&((), 1..=Edge::ALL.len())), LeadCells::schema(&())])
            .description("Where the electrodes are connected to the source: sides or cells of the membrane.")
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;

    fn scene(more: &str) -> Result<Scene, InputError> {
        Scene::from_text(&format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: [6, 4] }}, material: {{ \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, {more} }}"
        ))
    }

    const DRIVE: &str = "drive: { voltage: 5 kV }";

    #[test]
    fn leads_have_one_canonical_form_and_are_optional() {
        let plain = scene(DRIVE).unwrap();
        assert!(plain.leads.is_none() && !plain.to_text().contains("leads"));
        let sides = scene(&format!("{DRIVE}, leads: [top, left, top]")).unwrap();
        assert_eq!(sides.leads, Some(Leads::Edges(vec![Edge::Left, Edge::Top])));
        let cells = scene(&format!("{DRIVE}, leads: {{ cells: [[5, 3], [0, 1], [5, 3]] }}")).unwrap();
        assert_eq!(cells.leads, Some(Leads::Cells(vec![[0, 1], [5, 3]])));
        for scene in [&sides, &cells] {
            assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), *scene);
        }
        // A lead at one side is not at the other.
        let left = scene(&format!("{DRIVE}, leads: [left]")).unwrap();
        assert_eq!((plain.symmetries().count(), left.symmetries().count()), (4, 2));
        let supported = |sides: &str| {
            let geometry = format!("side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 4, sides: {{ {sides} }}");
            Scene::from_text(&format!(
                "{{ geometry: {{ {geometry} }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
                 relative_permittivity: 4.7 }}, {DRIVE}, leads: [left, right] }}"
            ))
        };
        assert!(supported("right: { bar: {} }, top: free, bottom: free").is_ok());
        let error = supported("right: free").unwrap_err().to_string();
        assert!(error.contains("along the right side"), "{error}");
        for (wrong, says) in [
            ("leads: left", "must be a list of sides"),
            ("leads: []", "is empty"),
            ("leads: [west]", "west"),
            ("leads: { cells: [[6, 0]] }", "the cell [6, 0]"),
            ("leads: { cells: [] }", "is empty"),
        ] {
            let error = scene(&format!("{DRIVE}, {wrong}")).unwrap_err();
            assert!(error.to_string().contains(says), "{wrong}: {error}");
        }
    }

    #[test]
    fn a_part_that_no_lead_reaches_is_found() {
        let drawn =
            |rows: [&str; 4]| Pattern::from_fn(Raster::new(6, 4).unwrap(), |x, y| rows[3 - y].as_bytes()[x] == b'#');
        let left = Leads::Edges(vec![Edge::Left]);
        assert_eq!(left.unreached(&drawn(["......", "......", "......", "......"])), None);
        assert_eq!(left.unreached(&drawn(["######", "#.....", "#.....", "######"])), None);
        // Corners do not connect.
        let diagonal = drawn(["###...", "...##.", "...##.", "......"]);
        let island = Unreached { cells: 4, at: [3, 1] };
        assert_eq!(left.unreached(&diagonal), Some(island));
        let cells = |cells: &[[usize; 2]]| Leads::Cells(cells.to_vec());
        assert_eq!(cells(&[[0, 3], [4, 2]]).unreached(&diagonal), None);
        assert_eq!(cells(&[[4, 2], [0, 0]]).unreached(&diagonal).unwrap().cells, 3);
    }

    #[test]
    fn electrodes_with_a_resistance_need_leads_and_a_voltage_of_their_own() {
        let known = "properties: { sheet_resistance: 50 kOhm, density: 960 }";
        let with = |drive: &str, effects: &str, leads: &str| {
            scene(&format!(
                "{drive}, effects: {{ electrode_resistance: {{}}, {effects} }}, {known}{leads}"
            ))
        };
        let on = with(DRIVE, "", ", leads: [left]").unwrap();
        let resistance = on.effects.electrode_resistance.unwrap().sheet_resistance;
        assert_eq!(resistance.value(), 50e3);
        for (drive, effects, leads, says) in [
            (DRIVE, "", "", "needs `leads`"),
            (DRIVE, "inertia: {}", ", leads: [left]", "inertia"),
            (DRIVE, "fringe_field: {}", ", leads: [left]", "fringe_field"),
            (
                DRIVE,
                "electrode_stiffness: { shear_modulus: 1 MPa, thickness: 1 um }",
                ", leads: [left]",
                "electrode_stiffness",
            ),
            (
                "drive: { voltages: [5 kV, 3 kV] }",
                "",
                ", leads: [left]",
                "differ by group",
            ),
            (
                "states: { a: { voltages: [5 kV, 3 kV] } }",
                "",
                ", leads: [left]",
                "differ by group",
            ),
            (
                "drive: { voltage: 5 kV, source: { resistance: 1 MOhm } }",
                "",
                ", leads: [left]",
                "a `source`",
            ),
            (
                "drive: { charge: { total: 1 uC } }",
                "",
                ", leads: [left]",
                "a `charge`",
            ),
        ] {
            let error = with(drive, effects, leads).unwrap_err();
            assert!(error.to_string().contains(says), "{drive} {effects}: {error}");
        }
        let unknown = scene(&format!(
            "{DRIVE}, effects: {{ electrode_resistance: {{}} }}, leads: [left]"
        ));
        assert!(unknown.unwrap_err().to_string().contains("has no `sheet_resistance`"));
    }
}
