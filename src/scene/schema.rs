//! What a scene may look like.

use serde_json::json;

use super::effects::{PermittivityReference, names};
use super::model::{Law, Scene};
use crate::base::{
    Dimension::{Density, Field, Frequency, Length, Number, Resistance, Stress, Time, Voltage},
    Fields, Schema,
};
use crate::pattern::CELLS;

impl Scene {
    /// What [`Scene::read`] accepts.
    #[must_use]
    pub fn schema() -> Schema {
        let effects = Schema::any_of([Schema::word(&["auto"]), effects().into()]);
        Fields::new("A membrane on a frame, its drive, and the effects that are simulated.")
            .required("geometry", geometry().into())
            .required("material", material().into())
            .required("drive", drive().into())
            .optional(
                "effects",
                effects
                    .says("What is simulated beyond the base model; auto: what is called for.")
                    .default(json!({})),
            )
            .optional("properties", properties().into())
            .into()
    }
}

fn geometry() -> Fields {
    Fields::new("The square membrane, prestretched and clamped on a rigid frame.")
        .required(
            "side",
            Schema::quantity(Length, 1e-3, 1e4).says("Side of the prestretched membrane."),
        )
        .required(
            "thickness",
            Schema::quantity(Length, 1e-4, 1e3).says("Undeformed thickness, before prestretch."),
        )
        .required(
            "prestretch",
            Schema::quantity(Number, 1.0, 10.0).says("Equibiaxial prestretch."),
        )
        .required(
            "cells",
            Schema::new(json!({ "const": CELLS })).says("Cells along a side."),
        )
}

fn material() -> Fields {
    Fields::new("The elastomer.")
        .required(
            "model",
            Schema::word(&[Law::NeoHookean.name()]).says("The elastic law."),
        )
        .required(
            "shear_modulus",
            Schema::quantity(Stress, 1.0, 1e9).says("Small-strain shear modulus."),
        )
        .required(
            "relative_permittivity",
            Schema::quantity(Number, 1.0, 1e4).says("Relative permittivity."),
        )
}

fn drive() -> Fields {
    Fields::new("What drives the actuator.")
        .required(
            "voltage",
            Schema::quantity(Voltage, 0.0, 1e6).says("Between the electrodes."),
        )
        .optional(
            "frequency",
            Schema::quantity(Frequency, 1e-9, 1e9).says("Where the voltage alternates. Only screening looks at it."),
        )
        .optional(
            "duration",
            Schema::quantity(Time, 1e-9, 1e9).says("How long the voltage is held. Only screening looks at it."),
        )
}

fn effects() -> Fields {
    Fields::new("Effects beyond the base model; each is off unless it is named.")
        .optional(names::STIFFENING, switched(stiffening()))
        .optional(names::ELECTRODE, switched(electrode().into()))
        .optional(names::PERMITTIVITY, switched(permittivity().into()))
        .optional(names::FRINGE, plain("The field bulges out at the edges of electrodes."))
        .optional(
            names::WRINKLING,
            plain("The membrane wrinkles instead of bearing compression."),
        )
        .optional(names::BREAKDOWN, switched(breakdown().into()))
        .optional(
            names::STABILITY,
            plain("The smallest eigenvalue of the tangent and the margin to pull-in are computed."),
        )
}

fn properties() -> Fields {
    let branch = Fields::new("A spring and a dashpot in series.")
        .required("modulus", Schema::quantity(Stress, 0.0, 1e12).says("Of the spring."))
        .required("time", Schema::quantity(Time, 1e-12, 1e12).says("Relaxation time."));
    Fields::new("What is known beyond the base model: for screening, and for effects without parameters of their own.")
        .optional(names::STIFFENING, stiffening())
        .optional(names::ELECTRODE, electrode().into())
        .optional(names::PERMITTIVITY, permittivity().into())
        .optional(names::BREAKDOWN, breakdown().into())
        .optional(
            names::VISCOELASTICITY,
            Schema::list(branch.into(), 0, usize::MAX).says("Branches beside the equilibrium one."),
        )
        .optional("density", Schema::quantity(Density, 1.0, 1e5).says("Of the elastomer."))
        .optional(
            "sheet_resistance",
            Schema::quantity(Resistance, 0.0, 1e15).says("Of a square of electrode."),
        )
}

/// An effect without parameters.
fn plain(says: &str) -> Schema {
    Schema::any_of([bare(), Fields::new("No parameters.").into()]).says(says)
}

/// An effect with parameters: its own, or with nothing, true or an empty mapping those of the properties.
fn switched(parameters: Schema) -> Schema {
    let empty = Schema::new(json!({ "type": "object", "maxProperties": 0 }));
    let empty = empty.says("With the parameters that stand in `properties`.");
    Schema::any_of([parameters, bare(), empty])
}

fn bare() -> Schema {
    Schema::new(json!({ "type": ["boolean", "null"] })).says("Whether it is on; nothing means on.")
}

fn stiffening() -> Schema {
    let model = |word: &str, says: &str| Fields::new(says).required("model", Schema::word(&[word]).says(says));
    let term = Fields::new("A term; half of the sum of mu · alpha is the shear modulus.")
        .required("mu", Schema::quantity(Stress, -1e9, 1e9))
        .required("alpha", Schema::quantity(Number, -15.0, 15.0).says("Not zero."));
    let stress = || Schema::quantity(Stress, -1e9, 1e9);
    let models = [
        model("gent", "Gent's model.").required("jm", Schema::number(1e-3, 1e12).says("Limit of I1 − 3.")),
        model("yeoh", "Yeoh's model; C1 is half the shear modulus.")
            .required("c2", stress())
            .required("c3", stress()),
        model("ogden", "Ogden's model.").required("terms", Schema::list(term.into(), 1, 3)),
        model("arruda-boyce", "Eight chains of limited extensibility.").required(
            "locking_stretch",
            Schema::number(1.0, 1e6).says("Stretch of a chain at which it locks."),
        ),
    ];
    Schema::any_of(models.map(Schema::from)).says("How the elastomer stiffens at large strains.")
}

fn electrode() -> Fields {
    Fields::new("The electrodes resist stretching.")
        .required("shear_modulus", Schema::quantity(Stress, 0.0, 1e12))
        .required(
            "thickness",
            Schema::quantity(Length, 0.0, 1e3).says("Of both together, on the prestretched membrane."),
        )
}

fn permittivity() -> Fields {
    let [first, second] = [PermittivityReference::Prestretched, PermittivityReference::Undeformed].map(|r| r.name());
    Fields::new("The permittivity falls as the membrane is stretched: ε ∝ J^(−s).")
        .required("exponent", Schema::number(-0.5, 0.9).says("s."))
        .optional(
            "reference",
            Schema::word(&[first, second])
                .says("Where the permittivity was measured.")
                .default(first),
        )
}

fn breakdown() -> Fields {
    let constant = json!({ "required": ["law"], "properties": { "law": { "const": "constant" } } });
    Fields::new("The field is compared with the one at which the elastomer breaks down.")
        .required(
            "law",
            Schema::word(&["huang", "constant"]).says("Huang's for VHB, or the same field everywhere."),
        )
        .optional(
            "field",
            Schema::quantity(Field, 1.0, 1e12).says("With `law: constant` only."),
        )
        .rule(json!({
            "if": constant,
            "then": { "required": ["field"] },
            "else": { "not": { "required": ["field"] } },
        }))
}
