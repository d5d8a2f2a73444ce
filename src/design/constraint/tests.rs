use super::*;
use deaflow_base::Stream;
use deaflow_pattern::{Raster, Region};

const MEMBRANE: Membrane = Membrane::square(50.0);

fn constraints(limits: Limits) -> Constraints {
    Constraints::new(limits, MEMBRANE).unwrap()
}

fn rectangle(from: [f64; 2], to: [f64; 2]) -> Region {
    Region::Rectangle([from, to])
}

/// Regions of random shape: noise averaged `grain` times, the highest `area` of it active.
fn blobs(index: u64, grain: usize, area: f64) -> Pattern {
    crate::Genome::random(area, grain, &mut Stream::new(7, "test", index)).pattern(Raster::PAPER)
}

/// Cells at random.
fn noise(index: u64) -> Pattern {
    let mut stream = Stream::new(7, "test", index);
    let cells: Vec<u8> = (0..2500).map(|_| u8::from(stream.chance(0.5))).collect();
    Pattern::from_cells(Raster::PAPER, &cells).unwrap()
}

fn all(min_feature_mm: f64) -> Limits {
    Limits {
        min_feature_mm: Some(min_feature_mm),
        islands: Some(2),
        leads: Some(Sides {
            left: true,
            top: true,
            ..Sides::default()
        }),
        keep_out: vec![
            rectangle([0.0, 0.0], [5.0, 5.0]),
            Region::Disc {
                centre: [25.0, 25.0],
                radius: 3.0,
            },
        ],
        ..Limits::default()
    }
}

#[test]
fn without_constraints_any_pattern_is_valid() {
    let free = Constraints::none(MEMBRANE);
    assert!(free.allow_any_pattern() && free.allowed().count() == 2500);
    assert_eq!((free.feature_cells(), free.largest_area()), ([1; 2], 1.0));
    for pattern in [
        noise(1),
        blobs(1, 2, 0.4),
        Pattern::from_fn(Raster::PAPER, |_, _| false),
    ] {
        assert!(free.satisfied_by(&pattern) && free.violations(&pattern).is_empty());
        assert_eq!(free.violations(&pattern).share(), 0.0);
        assert_eq!(free.masked(&pattern), pattern);
        assert_eq!(free.repaired(&pattern), Some(pattern));
    }
    assert_eq!(constraints(Limits::default()), free);
}

#[test]
fn widths_are_those_of_whole_cells() {
    let cells = |mm, side| {
        let limits = Limits {
            min_feature_mm: Some(mm),
            ..Limits::default()
        };
        Constraints::new(limits, Membrane::square(side))
            .unwrap()
            .feature_cells()[0]
    };
    assert_eq!([0.2, 1.0, 1.01, 2.0, 50.0].map(|mm| cells(mm, 50.0)), [1, 1, 2, 2, 50]);
    // 1.1 mm are 11 cells of 0.1 mm, although 1.1 / 0.1 is rounded to more than 11.
    assert_eq!(cells(1.1, 5.0), 11);
}

#[test]
fn cells_of_narrow_electrodes_and_gaps_are_counted() {
    let wide = constraints(Limits {
        min_feature_mm: Some(3.0),
        ..Limits::default()
    });
    // An electrode of 10 × 20 cells with a slot of 2 × 5 in it, and a bar of 2 × 8 beside it.
    let pattern = Pattern::from_fn(Raster::PAPER, |x, y| {
        let block = (10..20).contains(&x) && (10..30).contains(&y);
        let slot = (14..16).contains(&x) && (15..20).contains(&y);
        (block && !slot) || ((30..32).contains(&x) && (10..18).contains(&y))
    });
    let found = wide.violations(&pattern);
    assert_eq!((found.thin, found.narrow, found.kept_out), (16, 10, 0));
    assert_eq!(found.share(), 26.0 / 2500.0);
    let expected = "16 cells of electrode narrower than 3 mm; 10 cells of gap narrower than 3 mm";
    assert_eq!(found.to_string(), expected);
    let repaired = wide.repaired(&pattern).unwrap();
    assert_eq!(
        repaired,
        Pattern::from_fn(Raster::PAPER, |x, y| (10..20).contains(&x) && (10..30).contains(&y))
    );
    // At the frame a gap of any width will do, an electrode not.
    assert!(wide.satisfied_by(&Pattern::from_fn(Raster::PAPER, |x, _| x > 0 && x < 20)));
    assert!(!wide.satisfied_by(&Pattern::from_fn(Raster::PAPER, |x, _| x < 2)));
}

#[test]
fn surplus_islands_are_joined_or_removed() {
    let one = constraints(Limits {
        islands: Some(1),
        ..Limits::default()
    });
    // Two blocks of 100 cells three cells apart, and a speck far away.
    let pattern = Pattern::from_fn(Raster::PAPER, |x, y| {
        let row = (20..30).contains(&y);
        (row && ((5..15).contains(&x) || (18..28).contains(&x))) || (x, y) == (45, 45)
    });
    let found = one.violations(&pattern);
    assert_eq!((found.surplus, found.share()), (2, 101.0 / 2500.0));
    assert_eq!(found.to_string(), "3 islands, allowed: at most 1");
    let repaired = one.repaired(&pattern).unwrap();
    // A strip of three cells joins the blocks; the speck costs less than a strip to it.
    assert_eq!(repaired.active_cells(), 203);
    assert_eq!(Bits::of(&repaired).components().len(), 1);
}

#[test]
fn pieces_are_connected_to_leads() {
    let right = constraints(Limits {
        leads: Some(Sides {
            right: true,
            ..Sides::default()
        }),
        min_feature_mm: Some(2.0),
        ..Limits::default()
    });
    let pattern = Pattern::from_fn(Raster::PAPER, |x, y| (20..40).contains(&x) && (20..30).contains(&y));
    let found = right.violations(&pattern);
    let expected = "1 of 1 islands without a lead on the frame, allowed: right";
    assert_eq!((found.unled, found.to_string().as_str()), (1, expected));
    let repaired = right.repaired(&pattern).unwrap();
    assert!(right.satisfied_by(&repaired));
    // A strip two cells wide over the ten cells to the frame.
    assert_eq!(repaired.active_cells(), 200 + 20);
    // A piece that touches another side only has no lead.
    assert_eq!(
        right.violations(&Pattern::from_fn(Raster::PAPER, |x, _| x < 10)).unled,
        1
    );
    assert!(right.satisfied_by(&Pattern::from_fn(Raster::PAPER, |_, y| y < 10)));
}

#[test]
fn cells_in_keep_out_regions_are_inactive() {
    let limits = Limits {
        keep_out: vec![
            rectangle([5.0, 5.0], [0.0, 0.0]),
            Region::Disc {
                centre: [25.0, 25.0],
                radius: 3.0,
            },
        ],
        ..Limits::default()
    };
    let kept = constraints(limits);
    let full = Pattern::from_fn(Raster::PAPER, |_, _| true);
    // 5 × 5 cells, and the 32 cells with their centre within 3 cells of a corner.
    assert_eq!(kept.violations(&full).kept_out, 25 + 32);
    assert_eq!(kept.violations(&full).to_string(), "57 cells active where none may be");
    assert_eq!(kept.repaired(&full), Some(kept.masked(&full)));
    assert_eq!(kept.masked(&full).active_cells(), 2500 - 57);
    assert_eq!(kept.allowed().count(), 2500 - 57);
    assert!((kept.largest_area() - 0.9772).abs() < 1e-12);
    assert!(kept.check_area(0.98, 0.005).is_ok());
    let error = kept.check_area(0.99, 0.005).unwrap_err();
    assert!(matches!(error, ConstraintError::AreaTooLarge { area: 0.99, largest } if (largest - 0.9772).abs() < 1e-12));
    // Nothing is left of a pattern inside a keep-out region.
    assert_eq!(
        kept.repaired(&Pattern::from_fn(Raster::PAPER, |x, y| x < 4 && y < 4)),
        None
    );
}

#[test]
fn repaired_patterns_are_valid() {
    for feature in [1.0, 2.0, 3.0, 4.0, 7.0] {
        let constraints = constraints(all(feature));
        for index in 0..60 {
            for pattern in [
                blobs(index, 1 + index as usize % 5, 0.3 + 0.01 * index as f64),
                noise(index),
            ] {
                let Some(repaired) = constraints.repaired(&pattern) else {
                    // Noise may have no part that is wide enough.
                    assert!(
                        pattern == noise(index) && feature > 1.0,
                        "{feature} mm, pattern {index}"
                    );
                    continue;
                };
                let found = constraints.violations(&repaired);
                assert!(
                    found.is_empty() && found.share() == 0.0,
                    "{feature} mm, pattern {index}: {found}"
                );
                assert!(repaired.active_cells() > 0);
                assert_eq!(constraints.repaired(&repaired), Some(repaired.clone()));
                assert_eq!(constraints.repaired(&pattern), Some(repaired));
            }
        }
    }
}

#[test]
fn a_repair_changes_few_cells() {
    // Coarse regions change by corners and specks: 0.7 %, 1.7 % and 2.9 % of the cells in the mean.
    for (feature, most) in [(2.0, 0.01), (3.0, 0.02), (4.0, 0.035)] {
        let constraints = constraints(all(feature));
        let mut sum = 0.0;
        for index in 0..40 {
            let masked = constraints.masked(&blobs(index, 4, 0.5));
            let repaired = constraints.repaired(&masked).unwrap();
            sum += Bits::of(&masked).differing(&Bits::of(&repaired)) as f64 / 2500.0;
        }
        let mean = sum / 40.0;
        assert!(mean < most, "{feature} mm: {mean} of the cells");
    }
}

#[test]
fn contradictions_are_refused() {
    use ConstraintError as E;
    let error = |limits| Constraints::new(limits, MEMBRANE).unwrap_err();
    let limits = Limits::default;
    let feature = |mm| Limits {
        min_feature_mm: Some(mm),
        ..limits()
    };
    assert!(matches!(error(feature(51.0)), E::Feature { found: 51.0, .. }));
    for mm in [0.0, f64::NAN] {
        assert!(matches!(
            error(feature(mm)),
            E::Number {
                name: "min_feature",
                ..
            }
        ));
    }
    let islands = Limits {
        islands: Some(0),
        ..limits()
    };
    assert!(matches!(
        error(islands),
        E::Number {
            name: "islands",
            found: 0.0,
            ..
        }
    ));
    let margin = Limits {
        pull_in_margin: Some(0.9),
        ..limits()
    };
    assert!(matches!(
        error(margin),
        E::Number {
            name: "pull_in_margin",
            found: 0.9,
            ..
        }
    ));
    let outside = Limits {
        keep_out: vec![rectangle([0.0, 0.0], [5.0, 5.0]), rectangle([60.0, 0.0], [70.0, 5.0])],
        ..limits()
    };
    assert!(matches!(error(outside), E::Outside { number: 2, .. }));
    let everything = Limits {
        keep_out: vec![rectangle([0.0, 0.0], [50.0, 50.0])],
        ..limits()
    };
    assert_eq!(error(everything), E::NoSpace);
    let no_side = Limits {
        leads: Some(Sides::default()),
        ..limits()
    };
    assert_eq!(error(no_side), E::NoSide);
    let left = |sides| Limits {
        leads: Some(sides),
        keep_out: vec![rectangle([0.0, 0.0], [1.0, 50.0])],
        ..limits()
    };
    let listed = Sides {
        left: true,
        right: true,
        ..Sides::default()
    };
    assert_eq!(error(left(listed)), E::Side { side: "left" });
    assert!(Constraints::new(left(Sides::ALL), MEMBRANE).is_ok());
}

#[test]
fn only_cells_that_a_lead_can_reach_are_allowed() {
    // A wall divides the membrane, and leads are on the left only.
    let walled = Limits {
        leads: Some(Sides {
            left: true,
            ..Sides::default()
        }),
        keep_out: vec![rectangle([20.0, 0.0], [21.0, 50.0])],
        ..Limits::default()
    };
    let walled = constraints(walled);
    assert!((walled.largest_area() - 0.4).abs() < 1e-12);
    let right = Pattern::from_fn(Raster::PAPER, |x, _| x > 30);
    assert_eq!(walled.violations(&right).kept_out, right.active_cells());
    assert!(walled.check_area(0.5, 0.005).is_err());
    // Without leads, one island cannot be on both sides.
    let island = constraints(Limits {
        islands: Some(1),
        keep_out: vec![rectangle([20.0, 0.0], [21.0, 50.0])],
        ..Limits::default()
    });
    assert!((island.largest_area() - 0.58).abs() < 1e-12);
    // No electrode is smaller than the minimum width.
    let wide = constraints(Limits {
        min_feature_mm: Some(10.0),
        ..Limits::default()
    });
    assert!(wide.check_area(0.03, 0.005).is_err() && wide.check_area(0.0, 0.005).is_ok());
    assert!(wide.check_area(0.04, 0.0).is_ok());
}

fn domain(groups: usize) -> DesignDomain {
    DesignDomain {
        groups,
        ..MEMBRANE.into()
    }
}

/// Two or three groups at random, in regions.
fn grouped(index: u64, groups: u8) -> Pattern {
    let on = blobs(index, 4, 0.6);
    let layers: Vec<Pattern> = (1..u64::from(groups))
        .map(|group| blobs(100 * group + index, 5, 0.5))
        .collect();
    Pattern::from_groups(Raster::PAPER, |x, y| {
        let group = layers.iter().filter(|layer| layer.is_active(x, y)).count() as u8;
        u8::from(on.is_active(x, y)) * (1 + group)
    })
}

#[test]
fn groups_keep_the_gap_along_columns_or_rows() {
    let limits = Limits {
        gap_mm: Some(3.0),
        ..Limits::default()
    };
    let constraints = Constraints::new(limits.clone(), domain(2)).unwrap();
    assert!(!constraints.allow_any_pattern());
    let halves = |gap: usize| {
        Pattern::from_groups(Raster::PAPER, |x, _| match x {
            0..20 => 1,
            _ if x >= 20 + gap => 2,
            _ => 0,
        })
    };
    for (gap, holds) in [(0, false), (2, false), (3, true), (9, true)] {
        assert_eq!(constraints.satisfied_by(&halves(gap)), holds, "{gap}");
    }
    let found = constraints.violations(&halves(2));
    assert_eq!((found.near, found.lines().len()), (100, 1));
    assert!(found.lines()[0].contains("100 cells nearer than 3 mm to electrodes of another group"));
    // Corner to corner three columns apart.
    let corners = |apart: usize| {
        Pattern::from_groups(Raster::PAPER, |x, y| match (x, y) {
            (10, 10) => 1,
            (x, y) if (x, y) == (11 + apart, 11) => 2,
            _ => 0,
        })
    };
    assert!(constraints.satisfied_by(&corners(3)) && !constraints.satisfied_by(&corners(2)));
    assert_eq!(
        Constraints::new(limits, MEMBRANE).unwrap_err(),
        ConstraintError::OneGroup
    );
    let wide = Limits {
        gap_mm: Some(51.0),
        ..Limits::default()
    };
    assert!(matches!(
        Constraints::new(wide, domain(2)),
        Err(ConstraintError::Gap { .. })
    ));
}

#[test]
fn repaired_groups_are_valid() {
    for (groups, limits) in [
        (2, all(4.0)),
        (3, all(3.0)),
        (
            3,
            Limits {
                gap_mm: Some(2.0),
                ..Limits::default()
            },
        ),
        (
            2,
            Limits {
                gap_mm: Some(6.0),
                ..all(2.0)
            },
        ),
    ] {
        let constraints = Constraints::new(limits, domain(groups)).unwrap();
        let mut several = 0;
        for index in 0..20 {
            let pattern = grouped(index, groups as u8);
            let repaired = constraints.repaired(&pattern).unwrap();
            assert!(
                constraints.satisfied_by(&repaired),
                "{:?}",
                constraints.violations(&repaired)
            );
            assert!(constraints.violations(&repaired).is_empty());
            assert_eq!(
                constraints.repaired(&repaired),
                Some(repaired.clone()),
                "a valid pattern stays"
            );
            several += usize::from(repaired.groups() == groups);
        }
        assert!(several >= 10, "{several} of 20 kept all groups");
    }
}

#[test]
fn leads_reach_a_frame_of_any_shape() {
    let disc = |radius: f64| {
        Bits::from_fn(Raster::PAPER, move |x, y| {
            (x as f64 - 24.5).hypot(y as f64 - 24.5) < radius
        })
    };
    let within = |leads: Sides| {
        let limits = Limits {
            leads: Some(leads),
            ..Limits::default()
        };
        let domain = DesignDomain {
            available: Some(disc(20.0)),
            ..MEMBRANE.into()
        };
        Constraints::new(limits, domain).unwrap()
    };
    let left = Sides {
        left: true,
        ..Sides::default()
    };
    let strip = |range: std::ops::Range<usize>| {
        let available = disc(20.0);
        Pattern::from_fn(Raster::PAPER, move |x, y| {
            range.contains(&x) && (20..30).contains(&y) && available.has(x, y)
        })
    };
    for (pattern, any, from_left) in [
        (strip(0..25), true, true),
        (strip(25..50), true, false),
        (strip(15..35), false, false),
    ] {
        assert_eq!(within(Sides::ALL).satisfied_by(&pattern), any);
        assert_eq!(within(left).satisfied_by(&pattern), from_left);
    }
}

/// A pad at the left, one in the middle, and the leads on the left one.
fn pads() -> Limits {
    Limits {
        min_feature_mm: Some(2.0),
        islands: Some(1),
        pads: vec![Pad::Region(rectangle([0.0, 20.0], [3.0, 30.0]))],
        keep_in: vec![
            (1, rectangle([0.0, 22.0], [4.0, 28.0])),
            (
                1,
                Region::Disc {
                    centre: [40.0, 25.0],
                    radius: 3.0,
                },
            ),
        ],
        ..Limits::default()
    }
}

#[test]
fn repaired_patterns_have_the_electrodes_that_are_kept_in() {
    let constraints = constraints(pads());
    let kept = constraints.kept_in().unwrap();
    let kept = kept.iter().next().unwrap();
    assert!(kept.has(1, 25) && kept.has(40, 25) && !kept.has(20, 25), "both pads");
    let empty = Pattern::from_fn(Raster::PAPER, |_, _| false);
    let patterns = (0..30).flat_map(|k| [blobs(k, 2, 0.3), blobs(k, 6, 0.5), noise(k)]);
    for pattern in patterns.chain([empty.clone()]) {
        let repaired = constraints.repaired(&pattern).unwrap();
        let violations = constraints.violations(&repaired);
        assert!(
            constraints.satisfied_by(&repaired) && violations.is_empty(),
            "{violations}"
        );
        let bits = Bits::of(&repaired);
        assert!(kept.without(&bits).is_empty() && bits.components().len() == 1);
    }
    let violations = constraints.violations(&empty);
    assert_eq!(violations.bare, kept.count());
    assert!(!constraints.satisfied_by(&empty) && !constraints.allow_any_pattern());
    assert!(violations.to_string().contains("`keep_in`"), "{violations}");
    let kept_area = kept.count() as f64 / 2500.0;
    assert!(constraints.check_area(kept_area + 0.01, 0.005).is_ok());
    let error = constraints.check_area(kept_area - 0.01, 0.005).unwrap_err();
    assert!(matches!(error, ConstraintError::AreaBelowKeepIn { .. }), "{error}");
}

#[test]
fn each_group_keeps_its_own_electrodes() {
    let limits = Limits {
        gap_mm: Some(2.0),
        keep_in: vec![
            (1, rectangle([0.0, 0.0], [5.0, 5.0])),
            (2, rectangle([45.0, 45.0], [50.0, 50.0])),
        ],
        ..Limits::default()
    };
    let domain = DesignDomain {
        groups: 2,
        ..MEMBRANE.into()
    };
    let constraints = Constraints::new(limits, domain).unwrap();
    // All of it is of the other group.
    for group in [1, 2] {
        let full = Pattern::from_groups(Raster::PAPER, |_, _| group);
        let repaired = constraints.repaired(&full).unwrap();
        assert!(
            constraints.satisfied_by(&repaired),
            "{}",
            constraints.violations(&repaired)
        );
        assert_eq!((repaired.group(0, 0), repaired.group(49, 49)), (1, 2));
    }
}

#[test]
fn regions_that_no_pattern_can_keep_are_refused() {
    let refused = |change: fn(&mut Limits)| {
        let mut limits = pads();
        change(&mut limits);
        Constraints::new(limits, MEMBRANE).unwrap_err().to_string()
    };
    for (change, words) in [
        (
            (|limits| limits.keep_out = vec![rectangle([0.0, 22.0], [2.0, 24.0])]) as fn(&mut Limits),
            "may not have an electrode",
        ),
        (
            |limits| limits.keep_in.push((2, rectangle([9.0, 9.0], [12.0, 12.0]))),
            "is of group 2",
        ),
        (
            |limits| limits.keep_in.push((1, rectangle([60.0, 9.0], [70.0, 12.0]))),
            "no cell centre",
        ),
        (
            |limits| limits.keep_in.push((1, rectangle([9.0, 9.0], [10.0, 30.0]))),
            "narrower than `min_feature`",
        ),
        (
            |limits| limits.keep_in.push((1, rectangle([0.0, 29.0], [4.0, 33.0]))),
            "gaps narrower",
        ),
        (
            |limits| limits.pads = vec![Pad::Cell([60, 3])],
            "no cell at these places",
        ),
    ] {
        let error = refused(change);
        assert!(error.contains(words), "{error}");
    }
}
