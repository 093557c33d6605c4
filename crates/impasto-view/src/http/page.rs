//! The page, embedded in the program.

use axum::response::Response;

use super::reply::of_type;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! files {
    ($($address:literal => $kind:ident $file:literal),* $(,)?) => {
        const FILES: &[(&str, &str, &str)] = &[
            $(($address, $kind, include_str!(concat!("../../page/", $file)))),*
        ];
    };
}

files! {
    "/" => HTML "index.html",
    "/studio.css" => CSS "studio.css",
    "/studio.js" => SCRIPT "studio.js",
}

/// A file of the page.
pub(super) fn file(address: &str) -> Option<Response> {
    let (_, kind, text) = FILES.iter().find(|(known, _, _)| *known == address)?;
    Some(of_type(kind, *text))
}
