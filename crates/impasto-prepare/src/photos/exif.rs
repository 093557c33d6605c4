//! What EXIF tells of a camera.

use exif::{In, Reader, Tag};

/// Describes camera and lens setting, alike for photos that may share one calibration; empty when
/// nothing is told.
pub(super) fn lens(chunk: Vec<u8>) -> String {
    let Ok(exif) = Reader::new().read_raw(chunk) else {
        return String::new();
    };
    // The focal length says how a zoom was set; width and height are compared elsewhere.
    let tags = [
        Tag::Make,
        Tag::Model,
        Tag::BodySerialNumber,
        Tag::LensModel,
        Tag::FocalLength,
    ];
    let fields = tags
        .into_iter()
        .filter_map(|tag| exif.get_field(tag, In::PRIMARY));
    let values = fields.map(|field| field.display_value().to_string().trim().to_owned());
    values.collect::<Vec<String>>().join(" ")
}
