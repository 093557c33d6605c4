//! Results row by row.

use super::rows::ordered;
use crate::consistency::Consistency;
use crate::fidelity::PaintingResult;
use crate::html::escaped;
use crate::results::{Evaluation, MethodResult};

/// Columns and what they hold.
const COLUMNS: [(&str, &str); 14] = [
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
];

/// All methods' paintings and means. Fields without a number are empty.
pub(super) fn table(evaluation: &Evaluation) -> String {
    let mut text = COLUMNS.map(|(name, _)| name).join(",") + "\r\n";
    for (name, method) in ordered(evaluation) {
        for painting in &method.fidelity.paintings {
            text += &row(["painting", name, &painting.name], painting);
        }
        text += &row(["mean", name, ""], &mean(method));
    }
    text
}

/// A method's means in a painting's place.
fn mean(method: &MethodResult) -> PaintingResult {
    let fidelity = &method.fidelity;
    PaintingResult {
        name: String::new(),
        style_loss: fidelity.style_loss,
        style_gain: fidelity.style_gain,
        retrieved: fidelity.retrieval,
        taken_for: None,
        content_loss: fidelity.content_loss,
        consistency: method.consistency,
        sharpness: method.sharpness,
    }
}

fn row(names: [&str; 3], result: &PaintingResult) -> String {
    let of = |c: &Consistency| [c.e100, c.rmse, c.coverage];
    let consistency = result.consistency.as_ref();
    let consistency = consistency.map_or([[f64::NAN; 3]; 2], |c| c.each_ref().map(of));
    let [short, long] = consistency;
    let fidelity = [
        result.style_loss,
        result.style_gain,
        result.retrieved,
        result.content_loss,
    ];
    let sharpness = [result.sharpness.unwrap_or(f64::NAN)];
    let numbers = fidelity.into_iter().chain(short).chain(long);
    let numbers = numbers.chain(sharpness).map(|number| {
        let number = Some(number).filter(|n| n.is_finite());
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
