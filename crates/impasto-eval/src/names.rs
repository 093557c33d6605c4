//! Names of methods in results.

/// The stylised field.
pub(crate) const OURS: &str = "impasto";
/// The same with looks that have gone on learning from their painting.
pub(crate) const REFINED: &str = "impasto_refined";
/// The unstylised render's name among the methods: the floor of every consistency.
pub const PHOTO: &str = "photo";
/// What the name of a method's video variant ends with.
pub(crate) const TEMPORAL: &str = "_temporal";
/// What the name of a method ends with whose pictures the place was learned from.
pub(crate) const RECONSTRUCTED: &str = "_reconstructed";

/// Whether a method works on pictures alone: all but the floor, the model's own looks, and fields
/// that were reconstructed from stylised pictures.
pub(crate) fn two_dimensional(name: &str) -> bool {
    ![PHOTO, OURS, REFINED].contains(&name) && !name.ends_with(RECONSTRUCTED)
}
