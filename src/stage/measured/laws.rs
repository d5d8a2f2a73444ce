//! Fits of laws of elastomers, or of their viscoelastic branches, to tests of specimens.

use super::compare::Compared;
use super::curve::Measured;
use super::described::outlier;
use super::device::viscous_law;
use super::joint::rounded;
use crate::scene;
use deaflow_base::{Dimension, Document, InputError, Override, four_significant};
use deaflow_content::Quantities;
use deaflow_fit::{
    Candidate, Curve, Elastomer, Estimate, Fit, FitError, HistoryCurve, Law, LawKind, Options, Outlier, RelaxationFit,
    Verdict, ViscousLaw, compare, fit_histories,
};
use deaflow_scene::Scene;
use std::path::Path;

/// The laws that are compared if none is named.
pub const LAWS: [LawKind; 8] = [
    LawKind::NeoHookean,
    LawKind::Gent,
    LawKind::Yeoh,
    LawKind::MooneyRivlin,
    LawKind::ArrudaBoyce,
    LawKind::Ogden(1),
    LawKind::Ogden(2),
    LawKind::Ogden(3),
];

/// The most branches that are compared.
pub const MOST_BRANCHES: u64 = 6;

/// The difference of AICc from which on curves clearly decide between two laws (Burnham and Anderson, Model Selection
/// and Multimodel Inference, 2nd edition, section 2.6).
const CLEAR: f64 = 10.0;

/// The difference of AICc up to which curves do not distinguish two laws (the same).
const EQUAL: f64 = 2.0;

/// The ratio of the stresses of laws at the prestretch of a scene from which on a fit warns.
const DIFFERENT: f64 = 1.2;

/// The value of an override that removes a key.
const NONE: &str = "null";

/// The largest number of outliers that are listed.
const OUTLIERS: usize = 5;

/// Returns the law of a name, with the number of terms after a colon as in `ogden:3`; the allowed names if it is
/// unknown.
///
/// # Errors
/// The allowed names.
pub fn law_named(text: &str) -> Result<LawKind, &'static str> {
    let (name, terms) = text.split_once(':').unwrap_or((text, ""));
    let found = match (name, terms) {
        ("ogden", "") => Some(LawKind::Ogden(2)),
        ("ogden", "1" | "2" | "3") => Some(LawKind::Ogden(usize::from(terms.as_bytes()[0] - b'0'))),
        (_, "") => LAWS.into_iter().find(|known| known.name() == name),
        _ => None,
    };
    found.ok_or("neo-hookean, gent, yeoh, mooney-rivlin, arruda-boyce, ogden, ogden:1 to ogden:3")
}

/// Returns the name of a law with its number of terms.
#[must_use]
pub fn name_of_law(kind: LawKind) -> String {
    match kind {
        LawKind::Ogden(terms) => format!("ogden:{terms}"),
        kind => kind.name().to_owned(),
    }
}

/// Returns by how much AICc of a fit is above that of another one.
fn above(fit: &Fit, other: &Fit) -> f64 {
    fit.estimate.information.aicc - other.estimate.information.aicc
}

/// Returns the number of parameters of a law.
fn parameters_of(fit: &&Fit) -> usize {
    fit.law.kind().parameters().len()
}

/// A fit to tests of specimens.
pub enum SpecimenFit {
    /// Laws at equilibrium, the best first.
    Laws(Vec<Curve>, Vec<Candidate>),
    /// Numbers of branches of one law, the best first.
    Branches(Vec<HistoryCurve>, Vec<RelaxationFit>),
}

impl SpecimenFit {
    /// Fits laws to curves at equilibrium, or branches to relaxation.
    ///
    /// # Errors
    /// If there are both, or the measurements cannot be fitted.
    pub fn new(
        measured: Vec<Measured>,
        scene: &Scene,
        laws: &[LawKind],
        most_branches: usize,
    ) -> Result<Self, InputError> {
        let (mut curves, mut histories) = (Vec::new(), Vec::new());
        for one in measured {
            match one {
                Measured::Curve(curve) => curves.push(curve),
                Measured::History(history) => histories.push(history),
            }
        }
        let refused = |error: FitError| InputError::new(error.to_string());
        let options = Options::default();
        match (curves.is_empty(), histories.is_empty()) {
            (false, true) => {
                let laws = if laws.is_empty() { &LAWS[..] } else { laws };
                let found = compare(&curves, laws, &options).map_err(refused)?;
                Ok(Self::Laws(curves, found))
            }
            (true, false) => {
                let elastomer = elastomer(scene, laws)?;
                histories.iter_mut().for_each(|history| history.elastomer = elastomer);
                let found = fit_histories(&histories, most_branches, &options).map_err(refused)?;
                Ok(Self::Branches(histories, found))
            }
            (true, true) => Err(InputError::new("there is nothing to fit")),
            (false, false) => Err(
                InputError::new("curves at equilibrium and relaxation cannot be fitted at once")
                    .help("fit the law first, then the relaxation with the fitted scene"),
            ),
        }
    }

    /// Returns the laws that are stable and have parameters of their own, the best first.
    fn usable_laws(&self) -> impl Iterator<Item = &Fit> {
        let candidates = match self {
            Self::Laws(_, candidates) => &candidates[..],
            Self::Branches(..) => &[],
        };
        let fits = candidates.iter().filter_map(|found| found.fit.as_ref().ok());
        fits.filter(|fit| {
            !matches!(
                fit.verdict,
                Verdict::Unstable(..) | Verdict::ReducesTo(_) | Verdict::NotConverged
            )
        })
    }

    /// Returns the best law that is stable and has parameters of its own, if any. One with parameters that the curves
    /// do not determine gives way to the best one without such, if the curves do not clearly decide between both. Of
    /// the laws that the curves do not distinguish from it, that with the fewest parameters is chosen: more of them
    /// follow the noise, and are wrong at other deformations.
    #[must_use]
    pub fn chosen_law(&self) -> Option<&Fit> {
        let best = self.usable_laws().next()?;
        let is_near = |fit: &&Fit| above(fit, best) < CLEAR;
        let is_determined = |fit: &&Fit| fit.verdict == Verdict::Determined;
        let Some(first) = self.usable_laws().take_while(is_near).find(is_determined) else {
            return Some(best);
        };
        let equal = self.usable_laws().filter(|fit| above(fit, first) <= EQUAL);
        equal.filter(is_determined).min_by_key(parameters_of)
    }

    /// Says why a law was chosen although another one has a smaller AICc: that has undetermined parameters, or more of
    /// them.
    #[must_use]
    pub fn reason(&self) -> Option<String> {
        let (chosen, best) = (self.chosen_law()?, self.usable_laws().next()?);
        let name = |fit: &Fit| name_of_law(fit.law.kind());
        let why = match best.verdict == Verdict::Determined {
            true => format!("and {} has fewer parameters", name(chosen)),
            false => format!("but {}", best.verdict),
        };
        let less = || four_significant(above(chosen, best));
        (chosen.law.kind() != best.law.kind()).then(|| format!("AICc of {} is less by {}, {why}", name(best), less()))
    }

    /// Warns that laws between which the curves do not clearly decide have other stresses at the prestretch of a scene:
    /// curves of one test do not determine those of another.
    #[must_use]
    pub fn doubt_at_prestretch(&self, scene: &Scene) -> Option<String> {
        let chosen = self.chosen_law()?;
        let prestretch = scene.prestretch();
        let stress = |fit: &Fit| {
            let [along, across] = fit.law.nominal_stresses(prestretch)?;
            Some((fit.law.kind(), along.max(across)))
        };
        let is_near = |fit: &&Fit| above(fit, chosen) < CLEAR;
        let near = self.usable_laws().filter(is_near).filter_map(stress);
        let near: Vec<(LawKind, f64)> = near.filter(|(_, stress)| *stress > 0.0).collect();
        let (low, least) = *near.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let (high, most) = *near.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let factor = most / least;
        (factor > DIFFERENT).then(|| {
            let of = |kind, stress| format!("{} {}", name_of_law(kind), Dimension::Stress.with_unit(stress));
            let [along, across] = prestretch.map(four_significant);
            format!(
                "laws that fit about equally well differ by a factor of {} in the nominal stress at the prestretch of \
                 the scene, {along} × {across}: {}, {}; measure equibiaxial or pure shear tests up to this stretch, too",
                four_significant(factor),
                of(low, least),
                of(high, most)
            )
        })
    }

    /// Returns what is known about the chosen law or branches.
    #[must_use]
    pub fn chosen(&self) -> Option<(&Estimate, &Verdict, &[Outlier])> {
        match self {
            Self::Laws(..) => self
                .chosen_law()
                .map(|fit| (&fit.estimate, &fit.verdict, &fit.outliers[..])),
            Self::Branches(_, fits) => fits.first().map(|fit| (&fit.estimate, &fit.verdict, &fit.outliers[..])),
        }
    }

    /// Returns the law whose largest error at a test that is left out is the least, if it is not the chosen one.
    #[must_use]
    pub fn better_left_out(&self) -> Option<LawKind> {
        let Self::Laws(_, candidates) = self else { return None };
        let worst = |found: &Candidate| -> Option<f64> {
            let errors: Option<Vec<f64>> = found.left_out.iter().map(|(_, error)| *error).collect();
            errors?.into_iter().reduce(f64::max)
        };
        let known = candidates.iter().filter_map(|found| Some((worst(found)?, found.kind)));
        let (_, best) = known.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(best).filter(|best| Some(*best) != self.chosen_law().map(|fit| fit.law.kind()))
    }

    /// Returns the overrides that make a scene have the fitted elastomer.
    #[must_use]
    pub fn changes(&self, scene: &Scene) -> Option<Vec<String>> {
        let section = if scene.auto { "properties" } else { "effects" };
        let (kind, estimate) = match self {
            Self::Laws(..) => self.chosen_law().map(|fit| (fit.law.kind(), &fit.estimate))?,
            Self::Branches(_, fits) => fits.first().map(|fit| (fit.elastomer.law, &fit.estimate))?,
        };
        let values: Vec<f64> = estimate.parameters.iter().map(rounded).collect();
        let (of_law, of_branches) = values.split_at(kind.parameters().len());
        let law = kind.with(of_law)?;
        let has_law = match scene.auto {
            true => scene.properties.strain_stiffening.is_some(),
            false => scene.effects.strain_stiffening.is_some(),
        };
        let law_text = stiffening(&law).unwrap_or_else(|| NONE.to_owned());
        let stiffening = (has_law || law_text != NONE).then_some(&law_text);
        // That of the other laws is their first parameter, for Arruda and Boyce not the modulus at rest.
        let modulus = match law {
            Law::Ogden(_) => law.modulus_at_rest()?,
            _ => *values.first()?,
        };
        let branch = |pair: &[f64]| format!("{{ modulus: {} Pa, time: {} s }}", pair[0], pair[1]);
        let branches: Vec<String> = of_branches.chunks_exact(2).map(branch).collect();
        let viscous = match self {
            Self::Branches(_, fits) => fits.first().map(|fit| match fit.elastomer.viscous {
                ViscousLaw::Linear => "linear",
                ViscousLaw::Finite => "finite",
            }),
            Self::Laws(..) => None,
        };
        let viscous = viscous.filter(|_| !branches.is_empty());
        let viscous = viscous.map(|law| format!("{{ law: {law}, branches: [{}] }}", branches.join(", ")));
        // Law and branches that the scene knows of its former elastomer do not hold for the fitted one.
        let former = (!scene.auto).then_some(&scene.properties);
        let former_law = former.is_some_and(|known| known.strain_stiffening.is_some());
        let former_branches = former.is_some_and(|known| known.viscoelasticity.is_some());
        let all = [
            Some(format!("material.shear_modulus={modulus} Pa")),
            stiffening.map(|value| format!("{section}.strain_stiffening={value}")),
            former_law.then(|| format!("properties.strain_stiffening={law_text}")),
            viscous
                .as_ref()
                .map(|value| format!("{section}.viscoelasticity={value}")),
            viscous
                .filter(|_| former_branches)
                .map(|value| format!("properties.viscoelasticity={value}")),
        ];
        Some(all.into_iter().flatten().collect())
    }

    /// Returns what a user should know before using the fit.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let Some((_, verdict, outliers)) = self.chosen() else {
            return Vec::new();
        };
        let law = self.chosen_law();
        let mut warnings = Vec::new();
        let own = law.iter().flat_map(|fit| &fit.warnings);
        warnings.extend(own.map(ToString::to_string));
        if *verdict != Verdict::Determined {
            let name = law.map_or_else(String::new, |fit| format!("{}: ", fit.law.kind().name()));
            warnings.push(format!("{name}{verdict}"));
        }
        let falling = law.iter().flat_map(|fit| &fit.stability.falling);
        warnings.extend(falling.map(|(test, from, to)| {
            format!(
                "the nominal stress of a {} test falls from a stretch of {} to {}: unstable under a dead load",
                test.name(),
                four_significant(*from),
                four_significant(*to)
            )
        }));
        let listed = outliers.iter().take(OUTLIERS);
        warnings.extend(listed.map(|found| format!("outlier: {}", outlier(found))));
        if outliers.len() > OUTLIERS {
            warnings.push(format!("{} more outliers", outliers.len() - OUTLIERS));
        }
        warnings
    }

    /// Returns what was found about each law.
    #[must_use]
    pub fn verdicts(&self) -> Vec<String> {
        match self {
            Self::Laws(_, candidates) => candidates
                .iter()
                .map(|found| match &found.fit {
                    Ok(fit) => format!("{}: {}", name_of_law(found.kind), fit.verdict),
                    Err(error) => format!("{}: {error}", name_of_law(found.kind)),
                })
                .collect(),
            Self::Branches(..) => Vec::new(),
        }
    }

    /// Returns the scene with the fitted elastomer.
    ///
    /// # Errors
    /// If no law fits, or the scene cannot have it.
    pub fn scene(&self, scene: &Scene) -> Result<Scene, InputError> {
        let Some(changes) = self.changes(scene) else {
            return Err(InputError::new("no law fits the curves").help(self.verdicts().join("; ")));
        };
        let mut root = Document::from_text(Path::new("scene"), &scene.to_text())?.root;
        for change in changes {
            Override::of_scene(&change)?.apply(&mut root)?;
        }
        scene::read(&root)
    }

    /// Returns the measured numbers beside those of the chosen fit.
    ///
    /// # Errors
    /// If there is none, or it has no stress at a measured deformation.
    pub fn compared(&self) -> Result<Vec<Compared>, InputError> {
        let none = || InputError::new("no law fits the curves").help(self.verdicts().join("; "));
        match self {
            Self::Laws(curves, _) => {
                let law = &self.chosen_law().ok_or_else(none)?.law;
                let of = |curve: &Curve| {
                    let at = |stretch: &f64| law.nominal_stress(curve.test, *stretch);
                    let simulated = curve.stretch.iter().map(at).collect();
                    let numbers = (&curve.stretch[..], &curve.stress_pa[..], simulated);
                    Ok(Compared::series(
                        &curve.name,
                        Quantities::StretchStress,
                        numbers,
                        &curve.sigma,
                    ))
                };
                curves.iter().map(of).collect()
            }
            Self::Branches(curves, fits) => {
                let fit = fits.first().ok_or_else(none)?;
                let of = |curve: &HistoryCurve| {
                    let simulated = fit.stresses(curve.test, &curve.history, &curve.time_s);
                    let simulated = simulated.map_err(|error| InputError::new(error.to_string()))?;
                    let simulated = simulated.into_iter().map(Some).collect();
                    let numbers = (&curve.time_s[..], &curve.stress_pa[..], simulated);
                    Ok(Compared::series(
                        &curve.name,
                        Quantities::TimeStress,
                        numbers,
                        &curve.sigma,
                    ))
                };
                curves.iter().map(of).collect()
            }
        }
    }
}

/// Returns the elastomer of relaxation: with the given law or that of the scene, and its viscous law.
fn elastomer(scene: &Scene, laws: &[LawKind]) -> Result<Elastomer, InputError> {
    let (effects, properties) = (&scene.effects, &scene.properties);
    let own = effects
        .strain_stiffening
        .as_ref()
        .or(properties.strain_stiffening.as_ref());
    let law = match (laws, own) {
        ([law], _) => *law,
        ([], None) => LawKind::NeoHookean,
        ([], Some(own)) => {
            let known = LAWS.into_iter().find(|law| law.name() == own.word());
            known.unwrap_or(LawKind::NeoHookean)
        }
        (..) => return Err(InputError::new("relaxation is fitted with one law").help("name one law")),
    };
    let viscous = effects.viscoelasticity.as_ref().or(properties.viscoelasticity.as_ref());
    Ok(Elastomer {
        viscous: viscous_law(viscous),
        ..Elastomer::elastic(law)
    })
}

/// Returns a law as `strain_stiffening` of a scene; `None` for the base model.
fn stiffening(law: &Law) -> Option<String> {
    Some(match law {
        Law::NeoHookean { .. } => return None,
        Law::Gent { jm, .. } => format!("{{ model: gent, jm: {jm} }}"),
        Law::Yeoh { c2, c3, .. } => format!("{{ model: yeoh, c2: {c2} Pa, c3: {c3} Pa }}"),
        Law::MooneyRivlin { c2, .. } => format!("{{ model: mooney-rivlin, c2: {c2} Pa }}"),
        Law::ArrudaBoyce { locking_stretch, .. } => {
            format!("{{ model: arruda-boyce, locking_stretch: {locking_stretch} }}")
        }
        Law::Ogden(terms) => {
            // A modulus with nine digits agrees with the rounded parts of the shear modulus.
            let term = |term: &deaflow_fit::OgdenTerm| format!("{{ mu: {:.8e} Pa, alpha: {} }}", term.mu(), term.alpha);
            let terms: Vec<String> = terms.iter().map(term).collect();
            format!("{{ model: ogden, terms: [{}] }}", terms.join(", "))
        }
    })
}
