//! The macro that declares the content of an artifact.

/// Declares a struct whose fields are arrays of an artifact, and a view that reads them one by one:
///
/// ```text
/// arrays! {
///     /// Description of the struct.
///     pub struct Designs, DesignsView {
///         /// Electrode patterns, origin lower left, 1 = electrode.
///         patterns: Vec<Pattern> = array("patterns", "1", [row, y, x]),
///         /// The scene.
///         scene: Scene = attribute("scene"),
///         /// The history of the search.
///         history: History = group("history"),
///     }
/// }
/// ```
///
/// The comment of an array is its description in the file. The last axes are those of a row (a pattern has two). The
/// lengths of the others follow from the arrays: arrays that share an axis must be equally long. The arrays of a group
/// with the path "" are at the level of the struct; `group("area", [(group, bin)])` renames the axis `group` of its
/// arrays to `bin`.
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
            /// Opens a view of an artifact and checks the axes of its arrays.
            ///
            /// # Errors
            /// If an array has other axes, or two differ in length along a shared axis.
            pub fn open(artifact: &deaflow_store::Artifact) -> Result<$view<'_>, deaflow_store::StoreError> {
                $crate::view::open::<Self>(artifact)
            }

            /// Opens a view of an artifact without checking it; it may be of another kind.
            #[must_use]
            pub fn unchecked(artifact: &deaflow_store::Artifact) -> $view<'_> {
                <Self as $crate::view::Group>::view(artifact, $crate::part::At::default())
            }

            /// Reads all arrays and attributes.
            ///
            /// # Errors
            /// If one is missing or invalid.
            pub fn read(artifact: &deaflow_store::Artifact) -> Result<Self, deaflow_store::StoreError> {
                Self::open(artifact)?.read()
            }

            /// Converts it to an object for the store.
            #[must_use]
            pub fn object(self) -> deaflow_store::Object {
                let mut writer = $crate::writer::Writer::default();
                $crate::part::Part::put(self, &$crate::part::At::default(), &mut writer);
                writer.finish()
            }

            /// Returns the declarations of its arrays.
            #[must_use]
            pub fn declared() -> Vec<$crate::Declared> {
                let mut declared = Vec::new();
                <Self as $crate::part::Part>::declare(&$crate::part::At::default(), &mut declared);
                declared
            }

            /// Returns the names and descriptions of its attributes.
            #[must_use]
            // The macro expands to nothing for other fields, so the list cannot be a literal.
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
                    $( $field: $crate::macros::field!(
                        get $kind $args, $type, at, artifact, concat!($doc $(, $more)*)
                    ), )*
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

            /// Reads all arrays and attributes.
            ///
            /// # Errors
            /// If one is missing or invalid.
            pub fn read(&self) -> Result<$name, deaflow_store::StoreError> {
                $crate::part::Part::get(&self.at, self.artifact)
            }

            /// Returns the artifact.
            #[must_use]
            pub fn artifact(&self) -> &'a deaflow_store::Artifact {
                self.artifact
            }

            /// Whether the artifact has any of these arrays.
            ///
            /// # Errors
            /// If a chunk is missing or damaged.
            pub fn is_there(&self) -> Result<bool, deaflow_store::StoreError> {
                <$name as $crate::part::Part>::is_in(&self.at, self.artifact)
            }
        }
    };
}

/// Expands a field, which is an array, a group of arrays or an attribute.
macro_rules! field {
    (declare array ($path:literal, $units:literal, [$($axis:ident),*]), $type:ty, $at:ident, $out:ident, $doc:expr) => {
        <$type as $crate::part::Part>::declare(&$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $out)
    };
    (
        declare group ($path:literal $(, [$(($from:ident, $to:ident)),*])?),
        $type:ty, $at:ident, $out:ident, $doc:expr
    ) => {
        <$type as $crate::part::Part>::declare(
            &$at.group($path, &[$($((stringify!($from), stringify!($to))),*)?]),
            $out,
        )
    };
    (declare attribute $args:tt, $type:ty, $at:ident, $out:ident, $doc:expr) => {};

    (put array ($path:literal, $units:literal, [$($axis:ident),*]), $value:expr, $at:ident, $out:ident, $doc:expr) => {
        $crate::part::Part::put($value, &$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $out)
    };
    (
        put group ($path:literal $(, [$(($from:ident, $to:ident)),*])?),
        $value:expr, $at:ident, $out:ident, $doc:expr
    ) => {
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

    (
        get array ($path:literal, $units:literal, [$($axis:ident),*]),
        $type:ty, $at:ident, $artifact:ident, $doc:expr
    ) => {
        <$type as $crate::part::Part>::get(&$at.array($path, $units, &[$(stringify!($axis)),*], $doc), $artifact)?
    };
    (
        get group ($path:literal $(, [$(($from:ident, $to:ident)),*])?),
        $type:ty, $at:ident, $artifact:ident, $doc:expr
    ) => {
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
