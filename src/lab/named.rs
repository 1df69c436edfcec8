//! Enumerations whose values have names.

/// Declares an enumeration with the name of each value beside it.
///
/// The type gets `ALL`, its values in order, and `name`.
macro_rules! named {
    ($(#[$attribute:meta])* pub enum $type:ident {
        $($(#[$doc:meta])* $value:ident = $name:literal,)*
    }) => {
        $(#[$attribute])*
        pub enum $type {
            $($(#[$doc])* $value,)*
        }

        impl $type {
            /// All values, in the order of reports.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$value),*];

            /// Name of the value in flags and reports.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)*
                }
            }
        }
    };
}

pub(super) use named;
