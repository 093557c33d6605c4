//! How vectors and matrices are written as JSON.

/// A 4×4 matrix as four rows of four numbers.
pub(crate) mod rows {
    use glam::DMat4;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(matrix: &DMat4, to: S) -> Result<S::Ok, S::Error> {
        matrix.transpose().to_cols_array_2d().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<DMat4, D::Error> {
        <[[f64; 4]; 4]>::deserialize(from).map(|rows| DMat4::from_cols_array_2d(&rows).transpose())
    }
}

/// A 4×4 matrix as sixteen numbers, column by column.
pub(crate) mod columns {
    use glam::DMat4;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(matrix: &DMat4, to: S) -> Result<S::Ok, S::Error> {
        matrix.to_cols_array().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<DMat4, D::Error> {
        <[f64; 16]>::deserialize(from).map(|columns| DMat4::from_cols_array(&columns))
    }
}

/// A vector as three numbers.
pub(crate) mod triple {
    use glam::DVec3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer>(vector: &DVec3, to: S) -> Result<S::Ok, S::Error> {
        vector.to_array().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<DVec3, D::Error> {
        <[f64; 3]>::deserialize(from).map(DVec3::from_array)
    }
}
