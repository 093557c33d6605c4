//! Results row by row.

use super::ordered;
use crate::consistency::Consistency;
use crate::evaluate::{Evaluation, MethodResult};
use crate::fidelity::PaintingResult;
use crate::page::escaped;

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
        short: method.short,
        long: method.long,
        sharpness: method.sharpness,
    }
}

fn row(names: [&str; 3], result: &PaintingResult) -> String {
    let of = |range: Option<Consistency>| {
        let numbers = range.map(|c| [c.e100, c.rmse, c.coverage]);
        numbers.map_or([None; 3], |numbers| numbers.map(Some))
    };
    let fidelity = [
        result.style_loss,
        result.style_gain,
        result.retrieved,
        result.content_loss,
    ];
    let numbers = fidelity.map(Some).into_iter();
    let numbers = numbers
        .chain(of(result.short))
        .chain(of(result.long))
        .chain([result.sharpness]);
    let numbers = numbers.map(|number| {
        let number = number.filter(|n| n.is_finite());
        number.map_or_else(String::new, |number| number.to_string())
    });
    let fields: Vec<String> = names.map(field).into_iter().chain(numbers).collect();
    fields.join(",") + "\r\n"
}

/// Text as a field, quoted where it must be.
fn field(text: &str) -> String {
    match text.contains(['"', ',', '\r', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
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
