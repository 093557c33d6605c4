//! Results row by row.

use super::rows::ordered;
use crate::consistency::{ByRange, Consistency};
use crate::html::escaped;
use crate::results::Evaluation;
use crate::strokes::StrokeResult;

/// Columns and what they hold.
const COLUMNS: [(&str, &str); 16] = [
    ("row", "“painting”, or “mean” over a method's paintings"),
    ("method", "the method's name in report.json"),
    ("painting", "the painting's file; empty in a mean"),
    (
        "style_loss",
        "style distance of the stylised views to the painting",
    ),
    ("style_gain", "share of the distance that stylising removed"),
    (
        "retrieved",
        "share of views that are nearest to their own painting",
    ),
    ("content_loss", "content distance to the unstylised views"),
    ("short_e100", "E × 100, frames one apart"),
    ("short_rmse", "mean root of E, frames one apart"),
    (
        "short_coverage",
        "mean share of pixels compared, frames one apart",
    ),
    ("long_e100", "E × 100, frames seven apart"),
    ("long_rmse", "mean root of E, frames seven apart"),
    (
        "long_coverage",
        "mean share of pixels compared, frames seven apart",
    ),
    (
        "sharpness",
        "gradient energy relative to the unstylised frames",
    ),
    (
        "stroke_score",
        "how much nearer to the painting's strokes than a cheat by colour or grain",
    ),
    (
        "stroke_retrieval",
        "share of views whose own render has the nearest strokes of all renders of the view",
    ),
];

/// All methods' paintings and means. Fields without a number are empty.
pub(super) fn table(evaluation: &Evaluation) -> String {
    let mut text = COLUMNS.map(|(name, _)| name).join(",") + "\r\n";
    for (name, method) in ordered(evaluation) {
        for p in &method.fidelity.paintings {
            let fidelity = [p.style_loss, p.style_gain, p.retrieved, p.content_loss];
            let names = ["painting", name, &p.name];
            let rest = rest(p.sharpness, p.strokes);
            text += &row(names, fidelity, p.consistency.as_ref(), rest);
        }
        let f = &method.fidelity;
        let fidelity = [f.style_loss, f.style_gain, f.retrieval, f.content_loss];
        let consistency = method.consistency.as_ref();
        let rest = rest(method.sharpness, method.strokes);
        text += &row(["mean", name, ""], fidelity, consistency, rest);
    }
    text
}

/// The last columns.
fn rest(sharpness: Option<f64>, strokes: Option<StrokeResult>) -> [Option<f64>; 3] {
    [
        sharpness,
        strokes.map(|s| s.stroke_score),
        strokes.map(|s| s.stroke_retrieval),
    ]
}

fn row(
    names: [&str; 3],
    fidelity: [f64; 4],
    consistency: Option<&ByRange<Consistency>>,
    rest: [Option<f64>; 3],
) -> String {
    let of = |c: &Consistency| [c.e100, c.rmse, c.coverage];
    let ranges = consistency.map_or([[f64::NAN; 3]; 2], |c| c.each_ref().map(of));
    let numbers = fidelity.into_iter().chain(ranges.into_iter().flatten());
    let numbers = numbers.map(Some).chain(rest).map(|number| {
        let number = number.filter(|n| n.is_finite());
        number.map_or_else(String::new, |number| number.to_string())
    });
    let fields: Vec<String> = names.map(field).into_iter().chain(numbers).collect();
    fields.join(",") + "\r\n"
}

/// Text as a field, quoted where it must be.
fn field(text: &str) -> String {
    if text.contains(['"', ',', '\r', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// The columns, explained.
pub(super) fn legend() -> String {
    let rows = COLUMNS.map(|(name, meaning)| {
        format!(
            "<dt><code>{name}</code></dt><dd>{}</dd>\n",
            escaped(meaning)
        )
    });
    format!(
        "<section>\n<h2>Columns of report.csv</h2>\n<dl class=\"facts\">\n{}</dl>\n</section>\n",
        rows.concat()
    )
}
