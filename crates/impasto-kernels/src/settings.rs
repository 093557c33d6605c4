//! Settings that say, field by field, what they may be.

/// A setting that is out of range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("setting {key}: out of range, allowed: {allowed}")]
pub struct OutOfRange {
    /// Its dotted path.
    pub key: String,
    /// What it may be.
    pub allowed: &'static str,
}

impl OutOfRange {
    /// Of the setting `key` below `path`.
    pub fn new(path: &str, key: &str, allowed: &'static str) -> Self {
        let key = match path {
            "" => key.to_owned(),
            path => format!("{path}.{key}"),
        };
        Self { key, allowed }
    }
}

/// Whether a share is one.
pub fn share<T: PartialOrd + From<f32>>(v: &T) -> bool {
    *v >= 0f32.into() && *v <= 1f32.into()
}

/// Whether a rate or a weight is one: finite, not negative.
pub fn usable(v: f32) -> bool {
    v.is_finite() && v >= 0.0
}

/// Defines a struct of settings in which a field can be followed by what it must hold and how a
/// message says so: `pub samples: usize where |v| *v >= 2 => "2 or more",`. The struct gets
/// `check(&self, path)`, which fails with [`OutOfRange`] for the first field that does not hold.
#[macro_export]
macro_rules! settings {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$doc:meta])* pub $field:ident: $type:ty
            $(where |$v:ident| $holds:expr => $allowed:literal)?,)*
    }) => {
        $(#[$meta])*
        pub struct $name {
            $($(#[$doc])* pub $field: $type,)*
        }

        impl $name {
            /// Checks every field that has a range.
            ///
            /// # Errors
            /// The first one that is out of it, with its name behind `path`.
            pub fn check(&self, path: &str) -> Result<(), $crate::settings::OutOfRange> {
                $($({
                    let $v = &self.$field;
                    if !$holds {
                        let key = stringify!($field);
                        return Err($crate::settings::OutOfRange::new(path, key, $allowed));
                    }
                })?)*
                Ok(())
            }
        }
    };
}
