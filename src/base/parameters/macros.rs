//! The macros that declare parameters. Their expansions are short; all logic is in functions.

/// Declares a mapping; see `base::parameters`.
#[macro_export]
macro_rules! parameters {
    (
        $(#[doc = $about:literal])+
        $(#[derive($($derive:ident),+)])?
        $vis:vis struct $name:ident as $what:literal {
            $(
                $(#[doc = $doc:literal])+
                $field_vis:vis $field:ident : $type:ty $([$limits:expr])? $(= $default:expr)?
            ),* $(,)?
        }
        $(include {
            $($(#[doc = $part_doc:literal])+ $part_vis:vis $part:ident : $part_type:ty),+ $(,)?
        })?
        $(rules($rules:path))?
        $(check($check:path))?
        $(shared($shared:literal))?
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, Eq $($(, $derive)+)?)]
        $vis struct $name {
            $($(#[doc = $doc])+ $field_vis $field: $type,)*
            $($($(#[doc = $part_doc])+ $part_vis $part: $part_type,)+)?
        }

        $(impl $name {
            /// The name of its definition in schemas.
            pub const DEFINITION: &'static str = $shared;
        })?

        impl $crate::Declared for $name {
            const WHAT: &'static str = $what;

            fn keys() -> Vec<&'static str> {
                #[allow(unused_mut)]
                let mut keys = vec![$(stringify!($field)),*];
                $($(keys.extend(<$part_type as $crate::Declared>::keys());)+)?
                keys
            }

            fn add_to(fields: $crate::Fields) -> $crate::Fields {
                $(let fields = fields.declare::<$type>(
                    stringify!($field),
                    concat!($($doc),+),
                    $crate::parameters!(@limits $($limits)?),
                    $crate::parameters!(@default $type $(, $default)?),
                );)*
                $($(let fields = <$part_type as $crate::Declared>::add_to(fields);)+)?
                $(let fields = $rules(fields);)?
                fields
            }

            fn fields() -> $crate::Fields {
                Self::add_to($crate::Fields::new(concat!($($about),+).trim()))
            }

            #[allow(unused_variables)]
            fn read_map(map: &$crate::Map<'_>) -> ::std::result::Result<Self, $crate::InputError> {
                let read = Self {
                    $($field: map.read::<$type>(
                        $what,
                        stringify!($field),
                        $crate::parameters!(@limits $($limits)?),
                        $crate::parameters!(@default $type $(, $default)?),
                    )?,)*
                    $($($part: <$part_type as $crate::Declared>::read_map(map)?,)+)?
                };
                $($check(&read, map)?;)?
                Ok(read)
            }

            #[allow(unused_variables)]
            fn entries(&self, out: &mut Vec<(&'static str, $crate::Canonical)>) {
                $(out.extend(
                    $crate::Parameter::canonical(&self.$field).map(|value| (stringify!($field), value)),
                );)*
                $($($crate::Declared::entries(&self.$part, out);)+)?
            }
        }

        impl $crate::Parameter for $name {
            type Limits = ();
            type Literal = Self;

            fn read(node: &$crate::Node, _key: &str, (): &()) -> ::std::result::Result<Self, $crate::InputError> {
                <Self as $crate::Declared>::read_with(node, &[])
            }

            fn canonical(&self) -> ::std::option::Option<$crate::Canonical> {
                Some($crate::Declared::to_canonical(self))
            }

            fn schema((): &()) -> $crate::Schema {
                $crate::parameters!(@schema Self $(, $shared)?)
            }

            fn literal(literal: Self) -> Self {
                literal
            }
        }
    };
    (@schema $type:ty) => { <$type as $crate::Declared>::fields().into() };
    (@schema $type:ty, $shared:literal) => { $crate::Schema::reference($shared) };
    (@limits) => { &() };
    (@limits $limits:expr) => { &$limits };
    (@default $type:ty) => { None };
    (@default $type:ty, $default:expr) => { Some(<$type as $crate::Parameter>::literal($default)) };
}

/// Declares an enum of mappings, distinguished by the word of a key; see `base::parameters`.
#[macro_export]
macro_rules! variants {
    (
        $(#[doc = $about:literal])+
        $vis:vis enum $name:ident as $what:literal by $tag:literal {
            $($word:literal => $variant:ident($type:ty)),+ $(,)?
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, Eq)]
        $vis enum $name {
            $(#[doc = concat!("`", $tag, ": ", $word, "`.")] $variant($type),)+
        }

        impl $name {
            /// The words of the variants.
            pub const WORDS: &'static [&'static str] = &[$($word),+];

            /// The word of this variant.
            #[must_use]
            pub fn word(&self) -> &'static str {
                match self {
                    $(Self::$variant(_) => $word,)+
                }
            }

            /// Reads a mapping that can also have the keys `others`.
            ///
            /// # Errors
            /// When the word is unknown, or as for the variant.
            pub fn read_with(node: &$crate::Node, others: &[&str]) -> ::std::result::Result<Self, $crate::InputError> {
                // First check against the keys of all variants, so that a misspelt tag is not reported as missing.
                let mut keys = vec![$tag];
                $(keys.extend(<$type as $crate::Declared>::keys());)+
                keys.extend(others.iter().copied());
                keys.dedup();
                let map = node.fields($what, &keys)?;
                let allowed = |error: $crate::InputError| error.help(format!("allowed: {}", Self::WORDS.join(", ")));
                let word = map.required($what, $tag).map_err(allowed)?.word($tag, Self::WORDS)?;
                #[allow(unused_mut)]
                let mut others: Vec<&str> = others.to_vec();
                others.push($tag);
                let own = |of: &str| -> Vec<&'static str> {
                    match of {
                        $($word => <$type as $crate::Declared>::keys(),)+
                        _ => Vec::new(),
                    }
                };
                map.refuse_keys_of_others($tag, word, Self::WORDS, &own, &others)?;
                $(if word == $word {
                    return <$type as $crate::Declared>::read_with(node, &others).map(Self::$variant);
                })+
                unreachable!("the word is one of these")
            }

            /// Returns the mapping of each variant, for the schema and the reference.
            #[must_use]
            pub fn all_fields() -> Vec<$crate::Fields> {
                vec![$(<$type as $crate::Declared>::fields().tagged($tag, $word)),+]
            }
        }

        impl $crate::Parameter for $name {
            type Limits = ();
            type Literal = Self;

            fn read(node: &$crate::Node, _key: &str, (): &()) -> ::std::result::Result<Self, $crate::InputError> {
                Self::read_with(node, &[])
            }

            fn canonical(&self) -> ::std::option::Option<$crate::Canonical> {
                let mut entries = vec![($tag, $crate::Canonical::from(self.word()))];
                match self {
                    $(Self::$variant(own) => $crate::Declared::entries(own, &mut entries),)+
                }
                Some($crate::Canonical::map(entries))
            }

            fn schema((): &()) -> $crate::Schema {
                $crate::Schema::any_of(Self::all_fields().into_iter().map($crate::Schema::from))
            }

            fn literal(literal: Self) -> Self {
                literal
            }
        }
    };
}

/// Declares an enum of words; see `base::parameters`.
#[macro_export]
macro_rules! words {
    (
        $(#[doc = $about:literal])+
        $vis:vis enum $name:ident {
            $($(#[doc = $doc:literal])+ $variant:ident = $word:literal),+ $(,)?
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        $vis enum $name {
            $($(#[doc = $doc])+ $variant,)+
        }

        impl $name {
            /// All variants.
            pub const ALL: [Self; [$($word),+].len()] = [$(Self::$variant),+];

            /// The words of the variants, in the same order.
            pub const WORDS: &'static [&'static str] = &[$($word),+];

            /// The word in files.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)+
                }
            }

            /// Returns the variant for a word.
            #[must_use]
            pub fn from_name(word: &str) -> ::std::option::Option<Self> {
                Self::ALL.into_iter().find(|one| one.name() == word)
            }
        }

        impl $crate::Parameter for $name {
            type Limits = ();
            type Literal = Self;

            fn read(node: &$crate::Node, key: &str, (): &()) -> ::std::result::Result<Self, $crate::InputError> {
                let word = node.word(key, Self::WORDS)?;
                Ok(Self::from_name(word).expect("the word is one of these"))
            }

            fn canonical(&self) -> ::std::option::Option<$crate::Canonical> {
                Some(self.name().into())
            }

            fn schema((): &()) -> $crate::Schema {
                $crate::Schema::word(Self::WORDS)
            }

            fn literal(literal: Self) -> Self {
                literal
            }
        }
    };
}
