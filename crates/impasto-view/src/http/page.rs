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
    "/api.js" => SCRIPT "api.js",
    "/brush.js" => SCRIPT "brush.js",
    "/camera.js" => SCRIPT "camera.js",
    "/coat-list.js" => SCRIPT "coat-list.js",
    "/coats.js" => SCRIPT "coats.js",
    "/controls.js" => SCRIPT "controls.js",
    "/dom.js" => SCRIPT "dom.js",
    "/favourites.js" => SCRIPT "favourites.js",
    "/jobs.js" => SCRIPT "jobs.js",
    "/keys.js" => SCRIPT "keys.js",
    "/marks.js" => SCRIPT "marks.js",
    "/masks.js" => SCRIPT "masks.js",
    "/notices.js" => SCRIPT "notices.js",
    "/pace.js" => SCRIPT "pace.js",
    "/paintings.js" => SCRIPT "paintings.js",
    "/panel.js" => SCRIPT "panel.js",
    "/paths.js" => SCRIPT "paths.js",
    "/picker.js" => SCRIPT "picker.js",
    "/places.js" => SCRIPT "places.js",
    "/run.js" => SCRIPT "run.js",
    "/screen.js" => SCRIPT "screen.js",
    "/socket.js" => SCRIPT "socket.js",
    "/spline.js" => SCRIPT "spline.js",
    "/states.js" => SCRIPT "states.js",
    "/studio.js" => SCRIPT "studio.js",
    "/vectors.js" => SCRIPT "vectors.js",
}

/// A file of the page.
pub(super) fn file(address: &str) -> Option<Response> {
    let (_, kind, text) = FILES.iter().find(|(known, _, _)| *known == address)?;
    Some(of_type(kind, *text))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn every_file_of_the_page_is_served() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/page");
        let mut there: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| format!("/{}", entry.unwrap().file_name().to_string_lossy()))
            .map(|name| name.replace("/index.html", "/"))
            .collect();
        there.sort();
        let mut served: Vec<_> = FILES.iter().map(|(address, ..)| *address).collect();
        served.sort_unstable();
        assert_eq!(served, there);
    }
}
