//! Parts of HTML pages that hold everything themselves: escaped text and inline pictures.

use image::codecs::jpeg::JpegEncoder;
use image::{ImageError, RgbImage};

/// Text as it stands in HTML, between tags or in a quoted attribute.
pub(crate) fn escaped(text: &str) -> String {
    // The ampersand first: the others bring their own.
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

/// A picture as a JPEG of `quality` (1 to 100), as an address that holds it.
///
/// # Errors
/// If a side is zero or too long for the format.
pub(crate) fn data_url(image: &RgbImage, quality: u8) -> Result<String, ImageError> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, quality).encode_image(image)?;
    Ok(format!("data:image/jpeg;base64,{}", base64(&jpeg)))
}

/// Base 64 with padding (RFC 4648 §4).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i > three.len() { '=' } else { letter.into() });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn text_cannot_leave_its_place() {
        let safe = escaped("<img src=x onerror='a(\"&\")'>");
        assert_eq!(
            safe,
            "&lt;img src=x onerror=&#39;a(&quot;&amp;&quot;)&#39;&gt;"
        );
    }

    #[test]
    fn base64_is_the_standards() {
        // RFC 4648 §10.
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xfb, 0xff]), "+/8=");
    }

    #[test]
    fn a_picture_is_its_own_address() {
        let picture = RgbImage::from_pixel(5, 4, image::Rgb([200, 30, 60]));
        // Every JPEG begins with the bytes ff d8 ff.
        let url = data_url(&picture, 90).unwrap();
        assert!(url.starts_with("data:image/jpeg;base64,/9j/"), "{url}");
        assert!(data_url(&RgbImage::new(0, 3), 90).is_err());
    }
}
