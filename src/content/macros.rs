//! The declaration of an artifact's content.

/// Declares a struct whose fields are arrays of an artifact, and a view that reads them one by one:
///
/// ```text
/// arrays! {
///     /// What the struct is.
///     pub struct Designs, DesignsView {
///         /// Electrode patterns, origin lower left, 1 = electrode.
///         patterns: Vec<Pattern> = array("patterns", "1", [row, y, x]),
///         /// The scene that they are for.
///         scene: Scene = attribute("scene"),
///         /// How the search went.
///         history: History = group("history"),
///     }
/// }
/// ```
///
/// The comment of an array is its description in the file. The last axes are those of a row (a pattern has two), and the lengths
/// of the others are read off the arrays: arrays that share an axis are equally long. A group with the path "" stands beside the
/// other arrays; `group("area", [(group, bin)])` calls the axis `group` of its arrays `bin`.
macro_rules! arrays {
    (
        $(#[$meta:meta])*
        pub struct $name:ident, $view:ident {
            $( #[doc = $doc:literal] $(#[doc = $more:literal])* $field:ident: $type:ty = $kind:ident $args:tt ),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name {
            $( #[doc = $doc] $(#[doc = $more])* pub $field: $type, )*
        }

        impl $name {
            /// The view of an artifact, whose arrays have the declared axes as far as they are there.
            ///
            /// # Errors
            /// When an array has other axes, or two differ in length along one.
            pub fn open(artifact: &deaflow_store::Artifact) -> Result<$view<'_>, deaflow_store::StoreError> {
                $crate::view::open::<Self>(artifact)
            }

            /// The view of an artifact that may be of another kind: nothing is checked.
            #[must_use]
            pub fn unchecked(artifact: &deaflow_store::Artifact) -> $view<'_> {
                <Self as $crate::view::Group>::view(artifact, $crate::part::At::default())
            }

            /// Everything at once.
            ///
            /// # Errors
            /// When something is missing, or not what it should be.
            pub fn read(artifact: &deaflow_store::Artifact) -> Result<Self, deaflow_store::StoreError> {
                Self::open(artifact)?.read()
            }

            /// The same as an object that the store can keep.
            #[must_use]
            pub fn object(self) -> deaflow_store::Object {
                let mut writer = $crate::writer::Writer::default();
                $crate::part::Part::put(self, &$crate::part::At::default(), &mut writer);
                writer.finish()
            }

            /// What is declared of its arrays.
            #[must_use]
            pub fn declared() -> Vec<$crate::Declared> {
                let mut declared = Vec::new();
                <Self as $crate::part::Part>::declare(&$crate::part::At::default(), &mut declared);
                declared
            }

            /// What is declared of its attributes: their names and what they are.
            #[must_use]
            // Whether a field is an attribute is known as the macro expands, after a list would have been written.
            #[allow(clippy::vec_init_then_push)]
            pub fn attributes() -> Vec<(&'static str, &'static str)> {
                let mut _attributes = Vec::new();
                $( $crate::macros::field!(describe $kind $args, $type, _attributes, concat!($doc $(, $more)*)); )*
                _attributes
            }
        }

        impl $crate::part::Part for $name {
            fn declare(at: &$crate::part::At, declared: &mut Vec<$crate::Declared>) {
                $( $crate::macros::field!(declare $kind $args, $type, at, declared, concat!($doc $(, $more)*)); )*
            }

            fn put(self, at: &$crate::part::At, writer: &mut $crate::writer::Writer) {
                $( $crate::macros::field!(put $kind $args, self.$field, at, writer, concat!($doc $(, $more)*)); )*
            }

            fn get(
                at: &$crate::part::At,
                artifact: &deaflow_store::Artifact,
            ) -> Result<Self, deaflow_store::StoreError> {
                Ok(Self {
                    $( $field: $crate::macros::field!(get $kind $args, $type, at, artifact, concat!($doc $(, $more)*)), )*
                })
            }
        }

        impl $crate::view::Group for $name {
            type View<'a> = $view<'a>;

            fn view(artifact: &deaflow_store::Artifact, at: $crate::part::At) -> $view<'_> {
                $view { artifact, at }
            }
        }

        #[doc = concat!("[`", stringify!($name), "`] in an artifact, read array by array.")]
        #[derive(Clone)]
        pub struct $view<'a> {
            artifact: &'a deaflow_store::Artifact,
            at: $crate::part::At,
        }

        impl<'a> $view<'a> {
            $(
                #[doc = $doc]
                $(#[doc = $more])*
                #[must_use]
                pub fn $field(&self) -> $crate::macros::field!(type $kind $args, $type) {
                    $crate::macros::field!(view $kind $args, $type, self, concat!($doc $(, $more)*))
                }
            )*

            /// All of them at once.
            ///
            /// # Errors
            /// When something is missing, or not what it should be.
            pub fn read(&self) -> Result<$name, deaflow_store::StoreError> {
                $crate::part::Part::get(&self.at, self.artifact)
            }

            /// The artifact.
            #[must_use]
            pub fn artifact(&self) -> &'a deaflow_store::Artifact {
                self.artifact
            }

            /// Whether the artifact has any of these arrays.
            ///
            /// # Errors
            /// When a chunk is missing or damaged.
            pub fn is_there(&self) -> Result<bool, deaflow_store::StoreError> {
                <$name as $crate::part::Part>::is_in(&self.at, self.artifact)
            }
        }
    };
}

/// What each sort of field does: an array, a group of arrays or an attribute.
macro_rules! field {
    (declare array ($path:literal, $units:literal, [$($axis:ident),*]), $type:ty, $at:ident, $out:ident, $doc:expr) => {
        <$type as $crate::part::Part>::declare(&$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $out)
    };
    (declare group ($path:literal $(, [$(($from:ident, $to:ident)),*])?), $type:ty, $at:ident, $out:ident, $doc:expr) => {
        <$type as $crate::part::Part>::declare(
            &$at.group($path, &[$($((stringify!($from), stringify!($to))),*)?]),
            $out,
        )
    };
    (declare attribute $args:tt, $type:ty, $at:ident, $out:ident, $doc:expr) => {};

    (put array ($path:literal, $units:literal, [$($axis:ident),*]), $value:expr, $at:ident, $out:ident, $doc:expr) => {
        $crate::part::Part::put($value, &$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $out)
    };
    (put group ($path:literal $(, [$(($from:ident, $to:ident)),*])?), $value:expr, $at:ident, $out:ident, $doc:expr) => {
        $crate::part::Part::put(
            $value,
            &$at.group($path, &[$($((stringify!($from), stringify!($to))),*)?]),
            $out,
        )
    };
    (put attribute ($name:literal), $value:expr, $at:ident, $out:ident, $doc:expr) => {
        if let Some(text) = $crate::Attribute::into_text($value) {
            $out.attribute($name, text);
        }
    };

    (get array ($path:literal, $units:literal, [$($axis:ident),*]), $type:ty, $at:ident, $artifact:ident, $doc:expr) => {
        <$type as $crate::part::Part>::get(&$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $artifact)?
    };
    (get group ($path:literal $(, [$(($from:ident, $to:ident)),*])?), $type:ty, $at:ident, $artifact:ident, $doc:expr) => {
        <$type as $crate::part::Part>::get(
            &$at.group($path, &[$($((stringify!($from), stringify!($to))),*)?]),
            $artifact,
        )?
    };
    (get attribute ($name:literal), $type:ty, $at:ident, $artifact:ident, $doc:expr) => {
        $crate::StoredAttribute::<$type>::new($artifact, $name).read()?
    };

    (type array $args:tt, $type:ty) => { $crate::Stored<'a, $type> };
    (type attribute $args:tt, $type:ty) => { $crate::StoredAttribute<'a, $type> };
    (type group $args:tt, $type:ty) => { <$type as $crate::view::Group>::View<'a> };

    (view array ($path:literal, $units:literal, [$($axis:ident),*]), $type:ty, $view:ident, $doc:expr) => {
        $crate::Stored::new(
            $view.artifact,
            $view.at.array($path, $units, &[$(stringify!($axis)),*], $doc),
        )
    };
    (view attribute ($name:literal), $type:ty, $view:ident, $doc:expr) => {
        $crate::StoredAttribute::new($view.artifact, $name)
    };
    (view group ($path:literal $(, [$(($from:ident, $to:ident)),*])?), $type:ty, $view:ident, $doc:expr) => {
        <$type as $crate::view::Group>::view(
            $view.artifact,
            $view.at.group($path, &[$($((stringify!($from), stringify!($to))),*)?]),
        )
    };

    (describe attribute ($name:literal), $type:ty, $out:ident, $doc:expr) => {
        $out.push(($name, $doc.trim()))
    };
    (describe $kind:ident $args:tt, $type:ty, $out:ident, $doc:expr) => {};
}

pub(crate) use {arrays, field};
